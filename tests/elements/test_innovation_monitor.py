"""Innovation monitors: false alarms at the stated rate, each failure, both engines, gradients."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

import spacerobot as sr
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, final
from tests.elements import test_attitude_filter as attitude
from tests.elements import test_target_filter as target
from tests.elements.test_sampling import costed, difference
from tests.oracles.small_scenes import PLANAR, small_scene

SLOW, WINDOW = attitude.SLOW, 2
MONITOR = {
    "kind": "innovation_monitor",
    "filter": "known",
    "signal": "base_orientation",
    "window": WINDOW,
    "false_alarms": 1e-3,
}
STATE = "robots.chaser.estimators"


def monitored(failure=None, robot="chaser", delay_s=0.0, **options):
    """Changes: an attitude filter whose star tracker fails, and a monitor of its innovations."""
    found = attitude.filtered(delay_s, robot)
    found[f"robots.{robot}.estimators"]["watch"] = MONITOR | options
    if failure is not None:
        section = found[f"robots.{robot}.sensors"]
        section["base_orientation"] = section["base_orientation"] | {"failure": failure}
    return found


def detections(summary):
    return [event for event in summary["events"] if event["kind"] == "detected"]


def test_false_alarms_have_the_stated_rate():
    passes, windows, draws = 0.15, 2, 150
    changes = monitored(false_alarms=passes * 3600 / (WINDOW * SLOW))
    changes["robots.chaser.sensors"]["base_spin"] = attitude.GYRO | {
        "errors": attitude.GYRO["errors"] | {"period": SLOW}
    }
    duration = windows * WINDOW * SLOW - SLOW / 2

    def alarms(loop):
        signals = Signals.of(loop)
        measured = {"count": final(signals["failures_detected"])}
        return Measures(signals, measured, lambda r, p: {"alarms": r["count"][0]})

    scene = small_scene(attitude.PLATE, changes)
    loop = attitude.build_closed_loop(scene)
    steps = {"step_s": SLOW, "output_step_s": duration, "backend": "interpreted"}
    rollout = attitude.build_rollout(loop, duration_s=duration, measures=alarms(loop), **steps)
    numbers = np.arange(draws, dtype=float)[:, None]
    found = int(rollout.batch([attitude.DRAW], numbers).costs["alarms"].sum())
    low, high = binom.ppf([0.005, 0.995], draws, 1 - (1 - passes) ** windows)
    assert low <= found <= high
    assert 25 < low < high < 60  # a wrong threshold would be seen
    limit = rollout.run().outputs["innovation_limit"][0, 0]
    assert limit == pytest.approx(chi2.isf(passes / 2, WINDOW))


FAILURES = {
    "frozen": {"mode": "frozen", "at": 1.1},
    "drifting": {"mode": "drifting", "rate": 0.02, "at": 1.1},
    "lost": {"mode": "lost", "at": 1.1},
}


@pytest.mark.parametrize("failure", FAILURES.values(), ids=FAILURES)
def test_a_failed_star_tracker_is_detected_and_no_longer_used(failure):
    ends = {}
    for reject in (True, False):
        changes = monitored(failure, silence=0.6, reject=reject) | {"simulation.duration": 4}
        result = sr.simulate(small_scene(attitude.PLATE, changes), backend="interpreted")
        (event,) = detections(result.summary)
        assert event["who"] == "chaser/known.base_orientation"
        assert 0 < event["delay_s"] < (0.61 if failure["mode"] == "lost" else 1.01)
        ends[reject] = float(np.abs(result.data.attitude_estimate_error.values[-1]).max())
    if failure["mode"] == "lost":
        assert event["time_s"] == pytest.approx(1.0 + 0.6, abs=1e-9)
        assert ends[True] == ends[False]
    else:
        assert ends[True] < ends[False] / 2


def test_a_sensor_that_repeats_its_noise_at_rest_is_too_good():
    changes = monitored({"mode": "frozen", "at": 0.6}, window=8, false_alarms=1.0)
    changes |= {"robots.chaser.base.spin_deg": [0, 0, 0], "simulation.duration": 7}
    quiet = {"period": attitude.PERIOD, "noise": 1e-6, "bias": 1e-6}
    changes["robots.chaser.sensors"]["base_spin"] = {"kind": "gyro", "errors": quiet}
    result = sr.simulate(small_scene(attitude.PLATE, changes), backend="interpreted")
    (event,) = detections(result.summary)
    assert event["delay_s"] > 0
    limit = result.data.innovation_limit.values[-1, 0]
    assert 0 < result.data.innovation_sum.values[-1, 0] < limit / 10


def test_position_and_attitude_of_a_camera_are_told_apart():
    """Each has its own innovations; what fails is no longer used, and the other still is."""
    for failed, other in (
        ("target_position", "target_orientation"),
        ("target_orientation", "target_position"),
    ):
        changes = target.filtered("body", 0.3)
        for signal in (failed, other):
            watch = {"kind": "innovation_monitor", "filter": "seen", "signal": signal, "window": 3}
            changes["robots.chaser.estimators"][signal] = watch | {"false_alarms": 1e-3}
        failure = {"mode": "drifting", "rate": 0.05, "at": 2.1}
        changes["robots.chaser.sensors"][failed]["failure"] = failure
        result = sr.simulate(small_scene(target.PLATES, changes), backend="interpreted")
        (event,) = detections(result.summary)
        assert event["who"] == f"chaser/seen.{failed}"
        assert result.data.failures_detected.sel(body="chaser").values[-1] == 1
        places = {"target_position": 0, "target_orientation": 1}
        z = result.data.z
        used = {signal: z.sel({z.dims[1]: f"chaser/seen.used[{i}]"}) for signal, i in places.items()}
        end, after = result.data.time.values[-1], float(event["time_s"])
        assert used[failed].values[-1] <= after < end - 1
        assert used[other].values[-1] > end - 1


@pytest.mark.parametrize(("text", "delay_s"), [(attitude.PLATE, 0.1), (attitude.BOX, 0.0)])
def test_both_engines_agree(text, delay_s):
    changes = monitored({"mode": "drifting", "rate": 0.05, "at": 0.3}, delay_s=delay_s, silence=1)
    rollout = attitude.rolled(text, changes, 1.4, backend="interpreted", output_step_s=0.2)
    own, other = rollout.run(), simulate(small_scene(text, changes), duration_s=1.4, output_step_s=0.2)
    np.testing.assert_allclose(own.state, other.state, atol=1e-9)
    times = [one.time_s for one in own.events if rollout.loop.events[one.event].kind == "detected"]
    assert times == pytest.approx([one.time_s for one in other.happened if one.kind == "detected"], abs=1e-9)
    assert len(times) == 1


def test_gradients_go_through_detection():
    changes = attitude.controlled()
    drift = {"mode": "drifting", "rate": 0.2, "at": 0.1}
    changes["robots.one.sensors"]["base_orientation"] |= {"failure": drift}
    changes["robots.one.estimators"]["watch"] = MONITOR | {"window": 1}
    rollout = costed(changes, 0.83, backend="interpreted")
    happened = [rollout.loop.events[one.event].kind for one in rollout.run().events]
    assert happened.count("detected") == 1
    path = "robots.one.sensors.base_orientation.failure.rate"
    found = rollout.value_and_gradient(wrt=[path]).gradients["x"][0]
    assert abs(found) > 1e-3
    np.testing.assert_allclose(found, difference(rollout, path, 1e-4), rtol=1e-7)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"filter": "knwon"}, r"estimators\.watch\.filter: found no filter 'knwon' above it"),
        ({"signal": "base_spin"}, r"estimators\.watch\.signal: no innovations of 'base_spin'"),
        ({"silence": 0.2}, r"estimators\.watch\.silence: found 0\.2 s, allowed: above"),
        ({"false_alarms": 0}, r"false_alarms: found 0"),
    ],
)
def test_bad_input_is_one_line_at_its_place(options, expected):
    with pytest.raises(ScenarioError, match=expected):
        attitude.build_closed_loop(small_scene(attitude.PLATE, monitored(**options)))


def test_a_detection_begins_a_phase():
    phases = {
        "go": {"until": {"limit": {"output": "failures_detected", "of": "one", "above": 0.5}}},
        "safe": {"robots": {"one": {"controllers": {"turn": {"kp": 0, "kd": 5}}}}},
    }
    changes = attitude.controlled(0.1)
    changes["robots.one.sensors"]["base_orientation"] |= {
        "failure": {"mode": "drifting", "rate": 0.2, "at": 0.1}
    }
    changes["robots.one.estimators"]["watch"] = MONITOR | {"window": 1}
    changes |= {"phases": phases, "simulation.duration": 1.2}
    result = sr.simulate(small_scene(PLANAR, changes), backend="interpreted")
    times = {event["kind"]: event["time_s"] for event in result.summary["events"]}
    assert times["phase"] == pytest.approx(times["detected"], abs=1e-9)
    assert times["detected"] > 0.1
