"""Periodic controllers: convergence, the cost of a delay, both engines, gradients, and errors."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, build_rollout, final
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

ONE, TWO = "robots.one.tips.tip.pid", "robots.two.tips.tip.pid"
STEPS = {"step_s": 0.01, "output_step_s": 0.1}


def rolled(changes, text=PLANAR, duration_s=0.4, backend="interpreted", **options):
    scene = small_scene(text, changes)
    loop = build_closed_loop(scene)
    given = {"duration_s": duration_s, "backend": backend} | STEPS | options
    return scene, build_rollout(loop, **given)


def sampled(period, **more):
    return {"sampled": {"period": period} | more}


def plate(kp=0.0, ki=0.0, kd=0.0, **section):
    """A plate of two robots' scene, alone: its attitude is a double integrator."""
    turn = {"kind": "base_attitude", "kp": kp, "ki": ki, "kd": kd, "feed_forward": 0.0} | section
    return {
        "grasps": {},
        "target.base": {"joint": "planar", "position": [20, 0, 0]},
        "robots.two.base": {"joint": "planar", "position": [40, 0, 0]},
        "robots.one.tips.tip.pid": None,
        "robots.one.tips.tip.amnesia": None,
        "robots.two.tips.tip.pid": None,
        "robots.*.joints.*.locked": True,
        "robots.one.joints.joint_1.rate_deg": 0,
        "robots.one.actuators": {"ideal": {"kind": "base_wrench"}},
        "robots.one.controllers": {"turn": turn},
    }


KINDS = {
    "pid with amnesia": {ONE: sampled},
    "filtered derivative": {
        ONE: lambda period: sampled(period) | {"derivative": "filtered", "filter_time": 0.2}
    },
    "joint pd": {
        "robots.one.joint_pd": lambda period: {"kp": 20, "kd": 3} | sampled(period),
    },
    "base": {
        "robots.one.controllers": lambda period: {
            "turn": {"kind": "base_attitude", "kp": 40, "ki": 5, "kd": 20} | sampled(period)
        },
        "robots.one.actuators": lambda _: {"ideal": {"kind": "base_wrench"}},
    },
    "resolved rates": {
        "robots.one.controllers": lambda period: {"led": {"kind": "resolved_rate"} | sampled(period)},
        ONE: lambda _: None,
        "robots.one.tips.tip.amnesia": lambda _: None,
    },
}


def given(kind, period):
    """Changes of a scene in which a controller is sampled, or continuous."""
    found = {}
    for path, make in KINDS[kind].items():
        section = make(period or 1.0)
        if path == ONE and section is not None:
            found |= {f"{path}.{key}": value for key, value in section.items()}
        else:
            found[path] = section
    if period is None:
        found.pop(f"{ONE}.sampled", None)
        for section in found.values():
            for part in [section, *(section.values() if isinstance(section, dict) else [])]:
                if isinstance(part, dict):
                    part.pop("sampled", None)
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_a_sampled_controller_converges_to_the_continuous_one_at_first_order(kind):
    _, ideal = rolled(given(kind, None))
    wanted, errors = ideal.run().outputs["body_position"][-1], []
    for period in (0.02, 0.01, 0.005):
        _, rollout = rolled(given(kind, period))
        errors.append(np.abs(rollout.run().outputs["body_position"][-1] - wanted).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[0] > 1e-7
    np.testing.assert_allclose(slopes, 1, atol=0.15)


def inertia_of(scene):
    """About the centre of mass of the first robot, its joints locked [kg m^2]."""
    data = scene.model.createData()
    pin.crba(scene.model, data, scene.q)
    root = next(body for body in scene.robots if body.name == "one").root_joint
    return data.Ycrb[root].inertia[2, 2]


@pytest.mark.parametrize("late", [0.0, 0.4, 1.0, 2.0, 2.25])
def test_a_rate_loop_with_a_delay_follows_its_difference_equation_to_its_stability_limit(late):
    """omega_k+1 = omega_k - a (r omega_k-m-1 + (1 - r) omega_k-m) for a delay of m + r periods.

    For whole periods z^(m+1) - z^m + a has its roots on the unit circle at a = 2 sin(pi / (4 m + 2)).
    """
    period, whole = 0.05, int(late)
    limit, count = 2 * np.sin(np.pi / (4 * whole + 2)), 24
    ends = []
    for part in (0.95, 1.05):
        changes = plate(kd=1.0, **sampled(period, delay=late * period))
        inertia = inertia_of(small_scene(PLANAR, changes))
        changes["robots.one.controllers"]["turn"]["kd"] = part * limit * inertia / period
        steps = {"duration_s": count * period, "step_s": period, "output_step_s": period}
        rollout = rolled(changes, **steps)[1]
        run, rolled_names = rollout.run(), rollout.loop.state_names
        omega = run.state[:, rolled_names.index("v.one/root[2]")]
        wanted = [omega[0]]
        for k in range(count):
            before, now = (wanted[k - m] if k >= m else 0.0 for m in (whole + 1, whole))
            wanted.append(wanted[k] - part * limit * ((late - whole) * before + (1 - late + whole) * now))
        np.testing.assert_allclose(omega, wanted, atol=1e-10 * np.abs(wanted).max())
        ends.append(np.abs(omega[-2 * whole - 4 :]).max())
    if late == whole:
        assert ends[0] < abs(omega[0]) < ends[1]


def test_states_of_the_controller_advance_by_their_closed_forms():
    """An integral, a leak and a lag whose input is held over the period."""
    period, leak, lag = 0.02, 3.0, 0.05
    turn = {"kind": "base_attitude", "kp": 40, "ki": 5, "kd": 20, "sampled": {"period": period}}
    changes = {
        f"{ONE}.sampled": {"period": period},
        f"{ONE}.derivative": "filtered",
        f"{ONE}.filter_time": lag,
        "robots.one.tips.tip.amnesia.ta": leak,
        "robots.one.controllers": {"turn": turn},
        "robots.one.actuators": {"ideal": {"kind": "base_wrench"}},
    }
    _, rollout = rolled(changes, duration_s=0.2, output_step_s=period)
    run, names = rollout.run(), rollout.loop.state_names
    assert run.status == "completed"

    def state(name, size):
        return run.state[:, [names.index(f"{name}[{i}]") for i in range(size)]]

    turned = np.diff(state("one/turn.integral", 1)[1:], axis=0)[:, 0]
    asked = run.outputs["base_attitude_error"][2:, 2]
    np.testing.assert_allclose(turned, period * asked, rtol=1e-12, atol=1e-16)
    assert np.abs(turned).min() > 1e-6
    kept, decay = state("one/tip/amnesia", 2)[1:], np.exp(-leak * period)
    error = run.outputs["tip_error"][2:, :2]
    np.testing.assert_allclose(kept[1:], decay * kept[:-1] + (1 - decay) / leak * error, rtol=1e-12)
    integral, filtered = state("one/tip/pid.integral", 2)[1:], state("one/tip/pid.filter", 2)[1:]
    seen, decay = np.diff(integral, axis=0) / period, np.exp(-period / lag)
    np.testing.assert_allclose(
        filtered[1:], decay * filtered[:-1] + (1 - decay) * seen, rtol=1e-12, atol=1e-13
    )


def test_limits_rates_and_steps_of_the_output_hold():
    form = {"limit": 0.4, "rate_limit": 5.0, "resolution": 0.05}
    _, rollout = rolled(plate(kp=40, kd=10, **sampled(0.02, **form)), output_step_s=0.02)
    wheel = rollout.run()
    name = rollout.loop.state_names.index("one/controllers.turn.held[0]")
    held = wheel.state[:, name]
    assert np.abs(held).max() == pytest.approx(0.4)
    assert np.abs(np.diff(held[1:])).max() <= 5 * 0.02 + 0.05 + 1e-12
    np.testing.assert_allclose(held / 0.05, np.round(held / 0.05), atol=1e-9)
    assert len(np.unique(held.round(9))) > 3


def test_rounding_does_not_exceed_the_limit_of_the_output():
    """A limit of 7.6 steps, which rounds up to 8."""
    form = {"limit": 0.38, "resolution": 0.05}
    _, rollout = rolled(plate(kp=40, kd=10, **sampled(0.02, **form)), output_step_s=0.02)
    held = rollout.run().state[:, rollout.loop.state_names.index("one/controllers.turn.held[0]")]
    assert np.abs(held).max() == pytest.approx(0.38, rel=1e-14)
    inside = held[np.abs(held) < 0.37] / 0.05
    assert len(np.unique(inside.round())) == 3
    np.testing.assert_allclose(inside, np.round(inside), atol=1e-9)


def test_the_rate_of_the_output_is_limited_both_ways():
    _, rollout = rolled(
        plate(kp=4000, kd=400, **sampled(0.02, rate_limit=5.0)), duration_s=2.0, output_step_s=0.02
    )
    held = rollout.run().state[:, rollout.loop.state_names.index("one/controllers.turn.held[0]")]
    rates = np.diff(held[1:]) / 0.02
    np.testing.assert_allclose([rates.min(), rates.max()], [-5, 5], rtol=1e-12)


RATES = {
    f"{ONE}.sampled": {"period": 0.02, "delay": 0.03, "limit": 50.0, "rate_limit": 1000.0},
    f"{TWO}.sampled": {"period": 0.01},
    "robots.one.joint_pd": {"kp": 5.0, "kd": 1.0, "sampled": {"period": 0.05}},
}


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_both_engines_give_the_same_at_several_rates_in_one_scene(text):
    scene, rollout = rolled(RATES, text, duration_s=0.12, step_s=0.002)
    own, other = rollout.run(), simulate(scene, duration_s=0.12, output_step_s=0.1)
    assert sum(event.kind == "sampled" for event in other.happened) == 7 + 13 + 3
    np.testing.assert_allclose(own.state, other.state, atol=1e-9)


def costed(changes, duration_s, **options):
    loop = build_closed_loop(small_scene(PLANAR, changes))
    signals = Signals.of(loop)
    measures = Measures(
        signals, {"end": final(signals["tip_position"][:2])}, lambda r, p: {"x": r["end"][0] + r["end"][1]}
    )
    return build_rollout(loop, duration_s=duration_s, measures=measures, **(STEPS | options))


def difference(rollout, path, step):
    """Central differences, extrapolated."""
    value = rollout.values()[rollout.indices([path])[0]]
    steps = np.array([step, step / 2])
    ends = rollout.batch([path], (value + np.outer(steps, [1, -1]).ravel())[:, None]).costs["x"]
    coarse, fine = (ends[0] - ends[1]) / (2 * step), (ends[2] - ends[3]) / step
    return fine + (fine - coarse) / 3


def test_position_and_orientation_of_a_tip_are_solved_together():
    """At an instant their torques are those of the continuous laws, not an iteration towards them."""
    tip = "robots.one.tips.tip"
    gains = {"pid": {"kp": 30, "kd": 4}, "orientation_pid": {"kp": 20, "kd": 3}}
    changes = {f"{tip}.amnesia": None} | {f"{tip}.{key}": section for key, section in gains.items()}
    _, ideal = rolled(changes, SPATIAL, 0.01, output_step_s=0.01)
    held = {f"{tip}.{key}": section | sampled(0.02) for key, section in gains.items()}
    scene, rollout = rolled(changes | held, SPATIAL, 0.01, output_step_s=0.01)
    joints = len(scene.robots[0].driven_joints)
    wanted = ideal.run().outputs["joint_torque"][0, :joints]
    np.testing.assert_allclose(rollout.run().outputs["joint_torque"][1, :joints], wanted, rtol=1e-9)
    other = simulate(scene, duration_s=0.01, output_step_s=0.01).outputs["joint_torque"][1, :joints]
    np.testing.assert_allclose(other, wanted, rtol=1e-6)


def test_gradients_go_through_samples_periods_and_delays():
    """Of a gain, which moves no instant, and of a period and a delay, which move all of them."""
    changes = {f"{ONE}.sampled": {"period": 0.037, "delay": 0.051}, f"{TWO}.sampled": {"period": 0.05}}
    rollout = costed(changes, 0.26, backend="interpreted")
    paths = [f"{ONE}.kp", f"{ONE}.sampled.period", f"{ONE}.sampled.delay"]
    for path, step in zip(paths, (0.3, 4e-4, 4e-4), strict=True):
        found = rollout.value_and_gradient(wrt=[path])
        assert found.status == ("exact",)
        forward = rollout.jacobian(wrt=[path], orders=True).measures["end"]
        np.testing.assert_allclose(forward.sum(), found.gradients["x"][0], rtol=1e-9)
        wanted = difference(rollout, path, step)
        np.testing.assert_allclose(found.gradients["x"][0], wanted, rtol=1e-7)


def test_gradients_go_on_from_an_instant_at_which_an_output_is_sampled():
    """The samples act at 0.03, 0.13 and 0.23 s, and the outputs are shown at 0.13 s."""
    changes = {f"{ONE}.sampled": {"period": 0.1, "delay": 0.03}}
    rollout = costed(changes, 0.26, backend="interpreted", output_step_s=0.13)
    for path in (f"{ONE}.sampled.period", f"{ONE}.sampled.delay"):
        found = rollout.value_and_gradient(wrt=[path])
        assert found.status == ("exact",)
        np.testing.assert_allclose(found.gradients["x"][0], difference(rollout, path, 4e-4), rtol=1e-7)


QUANTISED = {
    "output": ({f"{ONE}.sampled": {"period": 0.02, "resolution": 0.05}}, "one/tip/pid"),
    "measurement": (
        {"robots.one.sensors": {"joint_rate": {"errors": {"period": 0.05, "resolution": 1e-3}}}},
        "one.joint_rate.3",
    ),
}


@pytest.mark.parametrize("kind", QUANTISED)
def test_gradients_through_steps_of_a_value_have_a_status_of_their_own(kind):
    changes, name = QUANTISED[kind]
    path, told = f"{ONE}.kp", f"inaccurate: quantised: derivatives leave out the steps of '{name}'"
    rollout = costed(changes, 0.1, backend="interpreted")
    assert rollout.value_and_gradient(wrt=[path]).status == (told,)
    assert rollout.jacobian(wrt=[path]).status == told
    assert rollout.slope_batch([path], [[10.0], [11.0]]).status == (told, told)


@pytest.mark.compiler
def test_compiled_lanes_and_adjoint_give_the_same_as_the_interpreter():
    changes = plate(kp=40, ki=5, kd=20, **sampled(0.02, delay=0.025)) | {"robots.two.joint_pd": {"kp": 1.0}}
    path = "robots.one.controllers.turn.sampled.period"
    ends, slopes = [], []
    for backend in ("interpreted", "compiled"):
        rollout = costed(changes, 0.2, backend=backend)
        ends.append(rollout.batch([path], np.linspace(0.018, 0.023, 9)[:, None]).costs["x"])
        slopes.append(rollout.value_and_gradient(wrt=[path], orders=True).gradients["x"])
    np.testing.assert_allclose(*ends, rtol=1e-12)
    np.testing.assert_allclose(*slopes, rtol=1e-9)


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ({"period": 0.0}, r"pid\.sampled\.period: found 0\.0, allowed: above 0"),
        ({"period": 0.01, "delay": 0.2}, r"delay: found 0\.2 s, allowed: at most 16 periods, 0\.16 s"),
        ({}, r"pid\.sampled\.period: missing"),
    ],
)
def test_a_period_or_a_delay_that_cannot_be_is_refused(section, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, {f"{ONE}.sampled": section})


def test_a_phase_does_not_change_a_period():
    own = {"robots": {"one": {"tips": {"tip": {"pid": {"sampled": {"period": 0.02}}}}}}}
    phases = {"phases": {"come": {"until": {"time": 0.37}}, "stay": own}}
    scene = small_scene(PLANAR, {f"{ONE}.sampled": {"period": 0.01}} | phases)
    with pytest.raises(ScenarioError, match=r"phases do not change it"):
        build_closed_loop(scene)


def test_a_controller_that_rests_in_a_phase_commands_nothing_from_its_next_instant_on():
    own = {"robots": {"one": {"tips": {"tip": {"pid": None, "amnesia": None}}}}}
    phases = {"phases": {"come": {"until": {"time": 0.1}}, "stay": own}}
    _, rollout = rolled({f"{ONE}.sampled": {"period": 0.03}} | phases, duration_s=0.2, output_step_s=0.01)
    run = rollout.run()
    held = run.state[:, rollout.loop.state_names.index("one/tip/pid.held[0]")]
    assert held[(run.time > 0.005) & (run.time < 0.115)].all()
    assert not held[run.time > 0.125].any()


def test_a_phase_that_resets_leaves_clocks_and_outputs_alone():
    phases = {"phases": {"come": {"until": {"time": 0.1}}, "stay": {"reset": True}}}
    _, rollout = rolled({f"{ONE}.sampled": {"period": 0.03}} | phases, duration_s=0.2, output_step_s=0.01)
    run, names = rollout.run(), rollout.loop.state_names
    count = run.state[:, names.index("one/tip/pid.samples.count[0]")]
    np.testing.assert_array_equal(count[1:], np.floor(run.time[1:] / 0.03 + 1e-9) + 1)
    integral = run.state[:, names.index("one/tip/pid.integral[0]")]
    assert abs(integral[9]) > 0 == abs(integral[11])
    assert run.state[11, names.index("one/tip/pid.held[0]")] != 0


@pytest.mark.parametrize("delay", [0.0, 0.2])
@pytest.mark.parametrize(("part", "grows"), [(0.97, False), (1.03, True)])
def test_sampled_damping_of_light_joints_is_stable_up_to_the_limit(part, grows, delay):
    """T K_d lambda < 2 / (1 - 2 f), lambda the largest eigenvalue of the joints' block of M^-1."""
    alone = {
        "grasps": {},
        "target.base": {"joint": "planar", "position": [20, 0, 0]},
        "robots.two.base": {"joint": "planar", "position": [40, 0, 0]},
        "robots.*.tips.tip.pid": None,
        "robots.one.tips.tip.amnesia": None,
        "robots.two.joints.*.locked": True,
        "robots.one.base": {"joint": "planar"},
        "robots.one.joints.joint_1.rate_deg": 1e-6,
    }
    scene = small_scene(PLANAR, alone)
    inertia = pin.crba(scene.model, scene.model.createData(), scene.q)
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    columns = [scene.model.idx_vs[joint] for joint in scene.robots[0].driven_joints]
    largest = np.linalg.eigvalsh(np.linalg.inv(inertia)[np.ix_(columns, columns)]).max()
    period = 0.01
    kd = part * 2 / (1 - 2 * delay) / (period * largest)
    damped = {
        "robots.one.joint_pd": {"kp": 0, "kd": kd, "sampled": {"period": period, "delay": delay * period}}
    }
    _, rollout = rolled(alone | damped, duration_s=0.6, output_step_s=0.1)
    rates = np.abs(rollout.run().state[:, scene.model.nq :][:, columns]).max(axis=1)
    assert bool(rates[-1] > 3 * rates[1]) is grows
    assert bool(rates[-1] < rates[1] / 3) is not grows
