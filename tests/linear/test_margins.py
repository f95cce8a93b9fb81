"""Margins of loops: closed forms, sampled loops, and the onset of instability in the time domain."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

from spacerobot.closedloop import build_closed_loop
from spacerobot.linear import linearise, margins
from spacerobot.linear.linearisation import RIGID, LinearSystem
from spacerobot.linear.loop_margins import MarginAnalysis, loop_margins
from spacerobot.linear.loop_response import frequency_grid, loop_response, responses
from spacerobot.rollout import build_rollout
from tests.linear.scenes import KD, KP, arm_scene


def reduced_inertia(scene, place):
    """Inertia that a torque at one place of v finds, everything else free."""
    mass = pin.crba(scene.model, scene.model.createData(), scene.q)
    return 1 / np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T)[place, place]


def own(found, name):
    return next(one for one in found.loops[0] if one.name == name)


def check_pd(found, inertia, kp, kd):
    """Margins of L = (K_d s + K_p) / (J s^2), which no gain makes unstable."""
    # |L| = 1: J^2 w^4 = K_p^2 + K_d^2 w^2
    crossover = np.sqrt((kd**2 + np.sqrt(kd**4 + 4 * kp**2 * inertia**2)) / 2) / inertia
    phase = np.arctan(kd * crossover / kp)
    omega = np.geomspace(1e-3, 1e3, 200001)
    loop = (1j * omega * kd + kp) / (inertia * (1j * omega) ** 2)
    disk = 1 / np.abs(1 / (1 + loop) - 0.5).max()
    assert (found.gain_up, found.gain_down) == (np.inf, -np.inf)
    np.testing.assert_allclose(found.crossover * 2 * np.pi, crossover, rtol=1e-6)
    np.testing.assert_allclose(found.phase, np.degrees(phase), rtol=1e-5)
    np.testing.assert_allclose(found.delay, phase / crossover, rtol=1e-5)
    np.testing.assert_allclose(found.disk, disk, rtol=1e-4)


@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_double_integrator_under_pd_broken_at_the_torque(base):
    scene = arm_scene(1, base)
    found = margins(scene, backend="interpreted")
    check_pd(own(found, "torque/arm/joint_1"), reduced_inertia(scene, -1), KP, KD)


def test_loop_broken_at_one_measurement_has_the_other_one_closed():
    """Rate: L = K_d s / (J s^2 + K_p), of infinite gain margin; position: K_p / (J s^2 + K_d s)."""
    scene = arm_scene(1)
    inertia, found = reduced_inertia(scene, -1), margins(scene, backend="interpreted")
    rate, position = (own(found, f"measurement/arm.joint_{kind}[0]") for kind in ("rate", "position"))
    assert (rate.gain_up, rate.gain_down) == (np.inf, -np.inf)
    assert rate.disk == pytest.approx(2, rel=1e-12)  # positive real: |S - 1/2| <= 1/2, reached where L = 0
    crossover = np.sqrt((-(KD**2) + np.sqrt(KD**4 + 4 * KP**2 * inertia**2)) / 2) / inertia
    phase = np.pi / 2 - np.arctan(inertia * crossover / KD)
    np.testing.assert_allclose(position.crossover * 2 * np.pi, crossover, rtol=1e-6)
    np.testing.assert_allclose(position.phase, np.degrees(phase), rtol=1e-5)
    np.testing.assert_allclose(position.delay, phase / crossover, rtol=1e-5)


def test_attitude_loop_broken_at_the_wheel():
    kp, kd = 3.0, 8.0
    wheels = {"kind": "reaction_wheels", "axes": [[0, 0, 1]], "inertia": 0.05, "speeds": [100]}
    attitude = {"kind": "base_attitude", "kp": kp, "kd": kd, "feed_forward": 0}
    hold = {"kind": "joint_pd", "kp": 0, "kd": 0}
    robot = {"controllers": {"hold": hold, "attitude": attitude}, "actuators": {"wheels": wheels}}
    scene = arm_scene(1, "planar", robot=robot)
    found = margins(scene, backend="interpreted")
    inertia = reduced_inertia(scene, 2)
    check_pd(own(found, "wheel/arm/wheels.0"), inertia, kp, kd)
    check_pd(own(found, "torque/arm/root[2]"), inertia, kp, kd)


@pytest.mark.parametrize("late", [0, 1, 2])
def test_gain_margin_of_a_sampled_rate_loop(late):
    """J w' = -k w, evaluated each T and acting m T later, is stable up to k T / J = 2 sin(pi / (4 m + 2))."""
    period = 0.05
    scene = arm_scene(1, "planar", kp=0.0, kd=1.0, sampled={"period": period, "delay": late * period})
    found = margins(scene, [0.2], backend="interpreted")
    limit = 2 * np.sin(np.pi / (4 * late + 2)) * reduced_inertia(scene, -1) / period
    for name in ("torque/arm/joint_1", "measurement/arm.joint_rate[0]"):
        np.testing.assert_allclose(10 ** (own(found, name).gain_up / 20), limit, rtol=1e-4)


def test_loops_of_two_periods_vary_in_time():
    robot = {
        "controllers": {
            "hold": {"kind": "joint_pd", "kp": KP, "kd": 0, "sampled": {"period": 0.02}},
            "brake": {"kind": "joint_pd", "kp": 0, "kd": KD, "sampled": {"period": 0.01}},
        }
    }
    found = margins(arm_scene(1, robot=robot), backend="interpreted")
    assert found.linearisations[0].period_s == pytest.approx(0.02)
    assert found.linearisations[0].is_stable
    assert np.isnan(own(found, "torque/arm/joint_1").disk)
    assert own(found, "measurement/arm.joint_position[0]").phase > 0  # seen once in each period


SAMPLED = {"kp": 12.0, "kd": 3.0}
PERIOD, DELAY = 0.1, 0.04


def scene_of(gain=1.0, period=PERIOD, delay=DELAY):
    scaled = {key: gain * value for key, value in SAMPLED.items()}
    return arm_scene(1, "planar", rate_deg=2, **scaled, sampled={"period": period, "delay": delay})


def growth(**changes):
    """Growth rate of the joint's motion [1/s]; the base's drift is far slower."""
    (found,) = linearise(scene_of(**changes), backend="interpreted")
    return max(mode.pole.real for mode in found.modes if abs(mode.pole) > 0.1)


def limit_of(what):
    """Gain, delay or period at which the closed loop is predicted to become unstable."""
    if what == "gain":
        return 10 ** (own(margins(scene_of(), backend="interpreted"), "torque/arm/joint_1").gain_up / 20)
    low, high = {"delay": (0.05, 0.25), "period": (0.1, 0.4)}[what]
    return brentq(lambda value: growth(**{what: value}), low, high, xtol=2e-3 * low)


@pytest.mark.parametrize("what", ["gain", "delay", "period"])
def test_predicted_instability_agrees_with_its_onset_in_the_time_domain(what):
    """One percent below the limit a motion decays, one percent above it grows."""
    limit = limit_of(what)
    for factor, grows in ((0.99, False), (1.01, True)):
        scene = scene_of(**{what: factor * limit})
        loop = build_closed_loop(scene)
        options = {"duration_s": 30.0, "step_s": 0.1, "output_step_s": 0.1, "backend": "interpreted"}
        run = build_rollout(loop, **options).run()
        assert run.status == "completed"
        rate = np.abs(run.state[:, loop.state_names.index("v.arm/joint_1")])
        third = len(rate) // 3
        assert (rate[-third:].max() > rate[third : 2 * third].max()) == grows, (what, factor)
        assert margins(scene, backend="interpreted").stable == [not grows], (what, factor)


def test_along_the_whole_time():
    found = margins(scene_of(), along=3, backend="interpreted")
    table = found.to_xarray()
    assert table.time.values.tolist() == [0, 0.5, 1]
    assert table.gain_up.attrs["units"] == "dB"
    values = table.phase.sel(loop="torque/arm/joint_1").values
    np.testing.assert_allclose(values, values[0], rtol=0.05)
    assert found.events == ()


def test_poles_at_zero_that_rounding_splits_are_no_resonances():
    """As of a floating base: four zeros of one Jordan block split by the fourth root of rounding."""
    poles = np.array([1.7e-3j, -1.7e-3j, -5e-3, -0.75 + 0.83j, -0.75 - 0.83j])
    assert frequency_grid(poles, np.inf).min() >= RIGID


def random_system(seed, size=7, loops=2):
    """Closed loop of random matrices, without a direct path."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(size, size)) - 2.5 * np.eye(size)
    B, C = rng.normal(size=(size, loops)), 2 * rng.normal(size=(loops, size))
    names = tuple(f"torque/{i}" for i in range(loops))
    states = tuple(f"x{i}" for i in range(size))
    return LinearSystem("random", 0.0, A, B, C, np.zeros((loops, loops)), states, names, names)


@pytest.mark.parametrize("seed", range(6))
def test_margins_are_those_of_python_control(seed):
    ct = pytest.importorskip("control")
    found = random_system(seed)
    for one in loop_margins(found):
        loop = found.loop_transfer(one.name)
        gains, phases, _, _, crossings, _ = ct.stability_margins(loop, returnall=True)
        gains = np.where(gains > 0, gains, np.nan)
        up, down = gains[gains > 1], gains[gains < 1]
        expected = [20 * np.log10(up.min(initial=np.inf))]
        expected += [20 * np.log10(down.max()) if down.size else -np.inf]
        expected += [np.abs((phases + 180) % 360 - 180).min(initial=np.inf)]
        np.testing.assert_allclose([one.gain_up, one.gain_down, one.phase], expected, rtol=1e-6)
        np.testing.assert_allclose(one.crossover * 2 * np.pi, max(crossings, default=np.nan), rtol=1e-8)
        near = one.frequencies["disk"] * np.linspace(0.99, 1.01, 401)
        if np.isfinite(near).all():
            np.testing.assert_allclose(one.disk, ct.disk_margins(loop, near)[0], rtol=1e-4)


def test_frequencies_keep_away_from_a_body_that_spins_freely():
    """It shakes a joint under PD: L = (k_d s + k_p) / s^2 to 1 % at all of them."""
    spin, kp, kd = 8.7266e-3, 12.0, 3.0
    A = np.array([[0, 1, 0, 0], [-kp, -kd, 0.3, 0.7], [0, 0, 0, spin], [0, 0, -spin, 0]])
    b, c = np.array([[0.0, 1, 0, 0]]).T, np.array([[-kp, -kd, 0, 0]])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]  # rounding in every entry
    closed = (turn @ A @ turn.T, turn @ b, c @ turn.T, np.zeros((1, 1)))
    omega = frequency_grid(np.linalg.eigvals(closed[0]), np.inf)
    s = 1j * omega
    assert np.abs(omega - spin).min() < 1e-5 * spin
    np.testing.assert_allclose(responses(closed, [0], s)[0], (kd * s + kp) / s**2, rtol=1e-2)


def test_a_response_shows_a_resonance_that_only_the_broken_loop_has():
    """L = r / (s^2 + 2 zeta w s + w^2), whose peak r / (2 zeta w^2) lies beside the closed loop's pole."""
    r, zeta, w = 0.1, 1e-5, 10.0
    A, B, C = np.array([[0, 1], [-(w**2) - r, -2 * zeta * w]]), np.array([[0.0], [1]]), np.array([[-r, 0.0]])
    found = LinearSystem("", 0.0, A, B, C, np.zeros((1, 1)), ("q", "v"), ("torque/q",), ("torque/q",))
    peak = np.abs(loop_response(found, "torque/q")[1]).max()
    np.testing.assert_allclose(peak, r / (2 * zeta * w**2), rtol=1e-3)


@pytest.mark.parametrize(("kd", "stable"), [(3.0, True), (-0.5, False)])
def test_a_drift_that_no_loop_causes_is_not_an_instability(kd, stable):
    """A joint under PD beside a mode that grows at 0.03 1/s, whatever the controller does."""
    A = np.array([[0, 1, 0], [-12.0, -kd, 0], [0, 0, 0.03]])
    B, C = np.array([[0, 1.0, 0]]).T, np.array([[-12.0, -kd, 0]])
    system = LinearSystem("", 0.0, A, B, C, np.zeros((1, 1)), ("q", "v", "x"), ("torque/q",), ("torque/q",))
    analysis = MarginAnalysis("", (system,), (tuple(loop_margins(system)),))
    assert system.growth_rate == pytest.approx(max(0.03, -kd / 2))
    assert analysis.stable == [stable]
    assert ("the motion drifts at 0.03 1/s" in analysis.descriptions[0]) == stable
    assert analysis.to_xarray().stable.values.tolist() == [stable]


def test_disk_margin_at_infinite_frequency():
    """L = -s / (2 (s + 1)) is nearest to -1 there: S = 2, alpha = 1 / |2 - 1/2|."""
    matrices = (np.array([[value]]) for value in (-2.0, 2.0, -1.0, 1.0))
    found = LinearSystem("", 0.0, *matrices, ("x",), ("torque/x",), ("torque/x",))
    (one,) = loop_margins(found)
    assert one.disk == pytest.approx(2 / 3, rel=1e-12)


def test_a_clock_that_ticks_once_has_no_period():
    """As that of the target filter's beginning, whose next instant is after any simulation."""
    joint = {"joint_position": {"errors": {"period": 0.05}}}
    expected = margins(arm_scene(1, robot={"sensors": joint}), backend="interpreted")
    once = joint | {"joint_rate": {"errors": {"period": 2e9}}}
    found = margins(arm_scene(1, robot={"sensors": once}), backend="interpreted")
    assert [one.period_s for one in found.linearisations] == [0.05]
    assert expected.linearisations[0].period_s == 0.05


def test_progress_counts_the_loops_of_each_instant():
    stages = list[str]()
    found = margins(arm_scene(1), [0.0, 0.5], backend="interpreted", progress=stages.append)
    count = len(found.loops[0])
    for label in ("0 s", "0.5 s"):
        first = stages.index(f"linearising at {label}")
        counted = [f"margins at {label}: {k} of {count} loops" for k in range(1, count + 1)]
        assert stages[first + 2 : first + 2 + count] == counted


def test_a_damping_ratio_that_rounds_to_zero_has_no_sign():
    A, nothing = np.array([[1e-7, 1.0], [-1.0, 1e-7]]), np.zeros((2, 0))
    system = LinearSystem("0 s", 0.0, A, nothing, nothing.T, np.zeros((0, 0)), ("q", "v"), (), ())
    assert system.modes[0].damping < 0
    assert [row[2] for row in system.mode_table().rows] == ["0.0000"]
