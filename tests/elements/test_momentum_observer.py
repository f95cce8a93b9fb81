"""Momentum observers: residuals in closed form, false alarms at the stated rate, brakes, gradients."""

import itertools
from statistics import NormalDist

import numpy as np
import pytest
from scipy.stats import binom

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, build_rollout, final
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

ALONE = """
name: alone
robots:
  one:
    urdf: arm.urdf
    base: {joint: planar, spin_deg: [0, 0, 2]}
    joints: {joint_1: {angle_deg: 50, rate_deg: 3}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: 35}}
simulation: {duration: 2, step: 0.004, output_step: 0.1}
"""
JOINTS = {"planar": (PLANAR, "joint_2"), "spatial": (SPATIAL, "slide")}
AT, ALLOWANCE = "robots.one.actuators.f.at", "robots.one.actuators.o.allowance"


def observed(joint=None, mode="free", at=0.15, failure=None, **options):
    """Changes of a scene: an observer of robot one, in front of a failure if a joint is given."""
    found = {"o": {"kind": "momentum_observer", "allowance": 0.05} | options}
    if joint is not None:
        found["f"] = {"kind": "joint_failure", "joint": joint, "mode": mode, "at": at} | (failure or {})
    return {"robots.one.actuators": found}


def rolled(text, changes, duration_s=0.3, measures=None, **options):
    loop = build_closed_loop(small_scene(text, changes | {"simulation.duration": duration_s}))
    found = None if measures is None else measures(loop)
    options = {"step_s": 0.004, "output_step_s": 0.01, "backend": "interpreted", "measures": found} | options
    return build_rollout(loop, duration_s=duration_s, **options)


def kinds(rollout, run):
    return [(rollout.loop.events[one.event].kind, one.time_s) for one in run.events]


@pytest.mark.parametrize("period", [None, 0.002])
@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_the_residual_is_the_missing_torque_behind_a_lag(text, joint, period):
    # half of the torque is missing from the start on; the tip is held and the base floats
    options = {"bandwidth": 20, "brake": False, "period": period}
    changes = observed(joint, "weak", at=0.0, failure={"remaining": 0.5}, **options)
    outputs = rolled(text, changes, output_step_s=0.001, step_s=0.001).run().outputs
    names = list(small_scene(text).scenario.robots["one"].joints)
    place = names.index(joint)
    delivered = outputs["joint_torque"][:, place].copy()
    delivered[0] /= 2  # shown before the failure at the same instant
    expected, decay = [0.0], np.exp(-20 * 0.001)
    for first, second in itertools.pairwise(delivered):
        expected.append(decay * expected[-1] - (1 - decay) * (first + second) / 2)
    found = outputs["joint_residual"]
    assert np.abs(expected).max() > 0.05
    held = 2e-3 if period is None else 0.06  # held over a period, the torque changes by that part
    np.testing.assert_allclose(found[:, place], expected, atol=held * np.abs(expected).max())
    others = [i for i in range(found.shape[1]) if i != place]
    assert np.abs(found[:, others]).max() < (1e-9 if period is None else 1e-4)


@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_a_free_joint_is_detected_and_braked(text, joint):
    scene = small_scene(text, observed(joint, period=0.005) | {"simulation.duration": 0.4})
    result = sr.simulate(scene, backend="interpreted")
    found = {event["kind"]: event for event in result.summary["events"]}
    assert found["detected"]["who"] == f"one/{joint}"
    assert found["detected"]["delay_s"] == pytest.approx(found["detected"]["time_s"] - 0.15, abs=1e-9)
    assert 0 < found["detected"]["delay_s"] < 0.05
    assert found["detected"]["time_s"] / 0.005 == pytest.approx(round(found["detected"]["time_s"] / 0.005))
    assert "delay_s" not in found["failed"]
    for kind in ("linear", "angular"):
        momentum = result.data[f"momentum_{kind}"].values
        assert np.abs(momentum - momentum[0]).max() < 1e-9, kind
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-7
    assert result.data.failures_detected.values[-1][0] == 1
    assert np.abs(result.data.brake_torque.values[-1]).max() > 0.05


def test_a_tip_side_observer_needs_nothing_of_the_base():
    # a wrench on the base that the observer does not know, and a tip that holds nothing
    base = {"kind": "base_attitude", "kp": 40, "kd": 20, "attitude_deg": [0, 0, 8]}
    found = {}
    for side in ("base", "tip"):
        changes = observed(side=side, brake=False) | {"robots.one.controllers": {"attitude": base}}
        changes["robots.one.actuators"]["b"] = {"kind": "base_wrench", "torque": 5}
        outputs = rolled(ALONE, changes).run().outputs
        found[side] = np.abs(outputs["joint_residual"]).max()
    assert found["tip"] < 1e-9
    assert found["base"] > 0.01


@pytest.mark.parametrize("period", [None, 0.01])
@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_both_engines_agree(text, joint, period):
    changes = observed(joint, at=0.08, period=period, joint_noise=1e-6 if period else 0.0)
    rollout, scene = rolled(text, changes, 0.2), small_scene(text, changes)
    own, other = rollout.run(), simulate(scene, duration_s=0.2, output_step_s=0.01)
    times = [event.time_s for event in other.happened if event.kind == "detected"]
    assert times == pytest.approx(
        [time for kind, time in kinds(rollout, own) if kind == "detected"], abs=1e-7
    )
    assert len(times) == 1
    np.testing.assert_allclose(own.state, other.state, atol=1e-6)


def costed(loop):
    signals = Signals.of(loop)
    return Measures(
        signals, {"end": final(signals["tip_position"][:2])}, lambda r, p: {"x": r["end"][0] + r["end"][1]}
    )


@pytest.mark.parametrize(("path", "period"), [(AT, None), (ALLOWANCE, None), (AT, 0.01)])
def test_gradients_are_exact(path, period):
    rollout = rolled(PLANAR, observed("joint_2", at=0.1337, period=period), 0.4, costed)
    found = rollout.value_and_gradient(wrt=[path])
    assert found.status == ("exact",)
    now = 0.1337 if path == AT else 0.05
    steps = now * np.array([4e-3, 2e-3])
    ends = rollout.batch([path], (now + np.outer(steps, [1, -1]).ravel())[:, None]).costs["x"]
    coarse, fine = (ends[0] - ends[1]) / (2 * steps[0]), (ends[2] - ends[3]) / (2 * steps[1])
    expected = fine + (fine - coarse) / 3
    assert abs(expected) > 1e-6
    assert found.gradients["x"][0] == pytest.approx(expected, rel=1e-3)


def test_lanes_detect_at_their_own_times():
    rollout, times = rolled(PLANAR, observed("joint_2"), 0.3, costed), np.array([0.0, 0.07, 0.2513, 3.0])
    found = rollout.batch([AT], times[:, None]).costs["x"]
    single = [rollout.batch([AT], [[time]]).costs["x"][0] for time in times]
    np.testing.assert_array_equal(found, single)
    assert len(set(found)) == 4


def test_noise_passes_the_threshold_at_the_stated_rate():
    # of one joint, for the errors of several joints are correlated
    period, passes, samples, draws = 0.02, 0.02, 10, 150
    options = {"period": period, "allowance": 0, "brake": False, "false_alarms": passes * 3600 / period}
    options |= {"joints": "joint_2", "joint_noise": 2e-4, "spin_noise": 5e-5, "velocity_noise": 1e-5}

    def alarms(loop):
        signals = Signals.of(loop)
        count = final(signals["failures_detected"][:1])
        return Measures(signals, {"count": count}, lambda r, p: {"alarms": r["count"][0]})

    duration = samples * period - 1e-3
    rollout = rolled(ALONE, observed(**options), duration, alarms, step_s=period, output_step_s=duration)
    numbers = np.arange(draws, dtype=float)[:, None]
    found = rollout.batch(["simulation.noise_draw"], numbers).costs["alarms"]
    alarmed, tests = int(found.sum()), draws
    # Boole's bound of a joint's alarm in all samples, and the same of the lag's residuals drawn independently
    bound = passes * (samples - 1)
    assert alarmed <= binom.ppf(0.999, tests, bound)
    rng, a = np.random.default_rng(0), np.exp(-50 * period)
    noise = rng.normal(size=(200_000, samples))
    residual, variance, over = np.zeros(len(noise)), 0.0, np.zeros(len(noise), dtype=bool)
    for k in range(1, samples):
        residual = a * residual + (1 - a) * (noise[:, k] - noise[:, k - 1])
        variance = residual.var()
        over |= np.abs(residual) > NormalDist().inv_cdf(1 - passes / 2) * np.sqrt(variance)
    low, high = binom.ppf([0.005, 0.995], tests, over.mean())
    assert low <= alarmed <= high
    assert 10 < low < high < 50  # a wrong threshold would be seen


def test_an_alarm_begins_a_phase_with_other_gains():
    phases = {
        "go": {"until": {"limit": {"output": "failures_detected", "of": "one", "above": 0.5}}},
        "safe": {"robots": {"one": {"tips": {"tip": {"pid": {"kp": 5, "ki": 0, "kd": 2}}}}}},
    }
    scene = small_scene(PLANAR, observed("joint_2") | {"phases": phases, "simulation.duration": 0.3})
    result = sr.simulate(scene, backend="interpreted")
    times = {event["kind"]: event["time_s"] for event in result.summary["events"]}
    assert times["phase"] == pytest.approx(times["detected"], abs=1e-9)
    assert times["detected"] > times["failed"]


def test_a_joint_that_locks_is_detected_and_held_once():
    scene = small_scene(PLANAR, observed("joint_2", "locked") | {"simulation.duration": 0.3})
    result = sr.simulate(scene, backend="interpreted")
    alone = small_scene(PLANAR, observed("joint_2", "locked", brake=False) | {"simulation.duration": 0.3})
    without = sr.simulate(alone, backend="interpreted")
    assert [event["kind"] for event in result.summary["events"]] == ["failed", "detected"]
    np.testing.assert_allclose(result.data.tip_position.values, without.data.tip_position.values, atol=1e-8)
    torque = without.data.brake_torque.values[:, 0]
    np.testing.assert_allclose(result.data.brake_torque.sel(brake="one/joint_2").values, torque, atol=1e-8)
    assert np.abs(torque).max() > 0.1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"joints": "elbow"}, r"actuators\.o\.joints: no joint 'elbow'"),
        ({"allowance": 0}, r"allowance: found 0, allowed: above 0"),
        ({"joint_noise": 1e-4}, r"joint_noise: found one, allowed: none without `period`"),
        ({"false_alarms": 0}, r"false_alarms: found 0"),
    ],
)
def test_bad_input_is_one_line_at_its_place(options, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, observed(**options))


def test_a_failure_that_it_would_not_see_is_refused():
    fails = {"f": {"kind": "joint_failure", "joint": "joint_2", "mode": "free", "at": 0.1}}
    observer = {"o": {"kind": "momentum_observer", "allowance": 0.2}}
    with pytest.raises(
        ScenarioError, match=r"actuators\.o: sees only failures .* robots\.one\.actuators\.f before"
    ):
        small_scene(PLANAR, {"robots.one.actuators": fails | observer})
    small_scene(PLANAR, {"robots.one.actuators": observer | fails})
