"""Joints that fail: impulses of locks, models without the joint, both engines, exact gradients, batches."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, build_rollout, final
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

JOINTS = {"planar": (PLANAR, "joint_2"), "spatial": (SPATIAL, "slide")}
MODES = ("locked", "free", "weak", "runaway")
AT = "robots.one.actuators.f.at"
OUTPUTS = ("tip_position", "body_rotation", "tip_error")


def failing(joint, mode="locked", at=0.15, **more):
    return {
        "robots.one.actuators": {
            "f": {"kind": "joint_failure", "joint": joint, "mode": mode, "at": at} | more
        }
    }


def rolled(text, changes, duration_s=0.4):
    loop = build_closed_loop(small_scene(text, changes))
    return build_rollout(loop, duration_s=duration_s, step_s=0.005, output_step_s=0.05, backend="interpreted")


@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_a_joint_that_locks_at_rest_is_the_model_without_it(text, joint):
    rate = {f"robots.one.joints.{joint}.{'speed' if joint == 'slide' else 'rate_deg'}": 0}
    failed = rolled(text, rate | failing(joint, at=0.0)).run().outputs
    without = rolled(text, rate | {f"robots.one.joints.{joint}.locked": True}).run().outputs
    intact = rolled(text, rate).run().outputs
    for name in OUTPUTS:
        np.testing.assert_allclose(failed[name], without[name], atol=1e-10, err_msg=name)
    assert np.abs(intact["body_rotation"] - failed["body_rotation"]).max() > 1e-6


@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_a_lock_is_an_internal_impulse(text, joint):
    scene = small_scene(text, failing(joint) | {"simulation.duration": 0.4})
    result, loop = sr.simulate(scene, backend="interpreted"), build_closed_loop(scene)
    event = next(e for e in result.summary["events"] if e["kind"] == "failed")
    assert event["who"] == f"one/{joint}"
    happened = (
        build_rollout(loop, duration_s=0.2, step_s=0.004, output_step_s=0.1, backend="interpreted")
        .run()
        .events
    )
    fired = next(one for one in happened if loop.events[one.event].kind == "failed")
    assert [fired.time_s, event["time_s"]] == pytest.approx([0.15, 0.15], abs=1e-12)
    model, before, after = scene.model, fired.before, fired.after
    q, v = before[: model.nq], before[model.nq : model.nq + model.nv]
    inertia = np.array(pin.crba(model, model.createData(), q))
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    row = np.zeros(model.nv)
    row[model.joints[model.getJointId(f"one/{joint}")].idx_v] = 1
    mobility = np.linalg.solve(inertia, row)
    expected = v - mobility * (row @ v) / (row @ mobility)
    assert abs(row @ v) > 1e-3
    np.testing.assert_allclose(after[model.nq : model.nq + model.nv], expected, atol=1e-12)
    for kind in ("linear", "angular"):
        momentum = result.data[f"momentum_{kind}"].values
        assert np.abs(momentum - momentum[0]).max() < 1e-9, kind
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-7
    lost = (row @ v) ** 2 / (row @ mobility) / 2
    assert result.data.work_event.values[-1] == pytest.approx(lost, rel=1e-9)


def test_a_weak_joint_delivers_what_remains_and_a_free_one_nothing():
    for mode, left in (("weak", 0.3), ("free", 0.0)):
        scene = small_scene(PLANAR, failing("joint_2", mode, **({"remaining": 0.3} if left else {})))
        loop = build_closed_loop(scene)
        c = loop.setup(loop.parameter_values)[1].full().ravel()
        rng = np.random.default_rng(0)
        x = np.array(loop.setup(loop.parameter_values)[0]).ravel()
        x[scene.model.nq : scene.model.nq + scene.model.nv] += 0.1 * rng.normal(size=scene.model.nv)
        named = loop.outputs.name_out().index("joint_torque")
        intact = loop.outputs(0.3, x, c)[named].full().ravel()
        c[list(loop.switches)] = 1.0
        failed = loop.outputs(0.3, x, c)[named].full().ravel()
        assert abs(intact[1]) > 1e-3
        np.testing.assert_allclose(failed, intact * np.array([1, left, 1, 1, 1, 1]), rtol=1e-12)


@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_a_joint_that_runs_on_keeps_its_rate_across_impacts_until_a_brake_stops_it(text, joint):
    """The motor that holds the rate does work, and in the impulse of another joint's lock as well."""
    other = {PLANAR: "joint_1", SPATIAL: "wrist"}[text]
    failures = {"f": {"joint": joint, "mode": "runaway", "at": 0.1}, "g": {"joint": other, "at": 0.2}}
    failures["h"] = {"joint": joint, "at": 0.33}
    actuators = {key: {"kind": "joint_failure"} | one for key, one in failures.items()}
    changes = {"robots.one.actuators": actuators, "simulation.duration": 0.4, "simulation.output_step": 0.02}
    scene = small_scene(text, changes)
    result = sr.simulate(scene, backend="interpreted")
    column = scene.model.joints[scene.model.getJointId(f"one/{joint}")].idx_v
    before, runs, stopped = (
        result.data.v.values[(result.data.time.values > a) & (result.data.time.values < b), column]
        for a, b in ((0.0, 0.1), (0.11, 0.33), (0.33, 0.5))
    )
    assert np.ptp(before) > 1e-4
    np.testing.assert_allclose(runs, runs[0], atol=1e-9)
    assert abs(runs[0]) > 1e-3
    np.testing.assert_allclose(stopped, 0, atol=1e-9)
    for kind in ("linear", "angular"):
        momentum = result.data[f"momentum_{kind}"].values
        assert np.abs(momentum - momentum[0]).max() < 1e-9, kind
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-9
    engine = simulate(scene, duration_s=0.4, output_step_s=0.1)
    own = rolled(text, {"robots.one.actuators": actuators}).run()
    np.testing.assert_allclose(own.state[::2], engine.state, atol=1e-7)


def test_an_arm_that_locks_is_the_model_without_its_joints():
    at_rest = {"robots.one.joints.joint_1.rate_deg": 0}
    failed = rolled(PLANAR, at_rest | failing("*", at=0.0)).run().outputs
    without = rolled(PLANAR, at_rest | {"robots.one.joints.*.locked": True}).run().outputs
    for name in OUTPUTS:
        np.testing.assert_allclose(failed[name], without[name], atol=1e-10, err_msg=name)


@pytest.mark.parametrize("order", [1, -1])
def test_two_locks_of_a_joint_are_one(order):
    """A whole arm locks after one of its joints has; which of them the scenario names first is the same."""
    failures = {"f": {"joint": "joint_2", "at": 0.1}, "g": {"joint": "joint_*", "at": 0.2}}
    keys = sorted(failures, reverse=order < 0)
    actuators = {key: {"kind": "joint_failure"} | failures[key] for key in keys}
    rollout = rolled(PLANAR, {"robots.one.actuators": actuators})
    run = rollout.run()
    columns = [rollout.loop.state_names.index(f"v.one/joint_{i}") for i in (1, 2, 3)]
    np.testing.assert_allclose(run.state[-3:, columns], 0, atol=1e-9)
    np.testing.assert_allclose(run.state[3, columns[1]], 0, atol=1e-9)
    assert np.abs(run.state[3, columns[0]]) > 1e-3


def test_a_failure_at_another_event_is_a_time_that_a_phase_changes():
    phases = {
        "first": {"until": {"time": 0.15}},
        "second": {"robots": {"one": {"actuators": {"f": {"at": 0}}}}, "until": {"time": 1}},
    }
    changes = failing("joint_2", at=100) | {"phases": phases, "simulation.duration": 0.3}
    result = sr.simulate(small_scene(PLANAR, changes), backend="interpreted")
    failed = next(event for event in result.summary["events"] if event["kind"] == "failed")
    assert failed["time_s"] == pytest.approx(0.15, abs=1e-9)
    known = sr.simulate(
        small_scene(PLANAR, failing("joint_2") | {"simulation.duration": 0.3}), backend="interpreted"
    )
    np.testing.assert_allclose(result.data.tip_position.values, known.data.tip_position.values, atol=1e-9)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("text", "joint"), JOINTS.values(), ids=JOINTS)
def test_both_engines_agree(text, joint, mode):
    scene, rollout = (
        small_scene(text, failing(joint, mode, at=0.08)),
        rolled(text, failing(joint, mode, at=0.08), 0.2),
    )
    own, other = rollout.run(), simulate(scene, duration_s=0.2, output_step_s=0.05)
    assert [event.kind for event in other.happened].count("failed") == 1
    np.testing.assert_allclose(own.state, other.state, atol=1e-7)


def costed(mode, backend="interpreted"):
    loop = build_closed_loop(small_scene(PLANAR, failing("joint_2", mode, at=0.1337)))
    signals = Signals.of(loop)
    measures = Measures(
        signals, {"end": final(signals["tip_position"][:2])}, lambda r, p: {"x": r["end"][0] + r["end"][1]}
    )
    return build_rollout(
        loop, duration_s=0.4, step_s=0.005, output_step_s=0.1, backend=backend, measures=measures
    )


@pytest.mark.parametrize("mode", MODES)
def test_gradients_by_the_time_of_failure_are_exact(mode):
    rollout, at = costed(mode), 0.1337
    found = rollout.value_and_gradient(wrt=[AT])
    assert found.status == ("exact",)
    steps = np.array([2e-3, 1e-3])
    ends = rollout.batch([AT], (at + np.outer(steps, [1, -1]).ravel())[:, None]).costs["x"]
    coarse, fine = (ends[0] - ends[1]) / (2 * steps[0]), (ends[2] - ends[3]) / (2 * steps[1])
    expected = fine + (fine - coarse) / 3
    assert abs(expected) > 1e-6
    assert found.gradients["x"][0] == pytest.approx(expected, rel=1e-4)


def test_lanes_fail_at_their_own_times():
    rollout, times = costed("locked"), np.array([0.0, 0.07, 0.2513, 0.4, 3.0])
    found = rollout.batch([AT], times[:, None]).costs["x"]
    single = [rollout.batch([AT], [[time]]).costs["x"][0] for time in times]
    np.testing.assert_array_equal(found, single)
    assert len(set(found[:3])) == 3
    assert found[4] == pytest.approx(found[3], abs=1e-12)


@pytest.mark.compiler
def test_compiled_and_interpreted_rollouts_agree():
    times = np.linspace(0.05, 0.35, 5)[:, None]
    first, second = (
        costed("locked", backend).batch([AT], times).costs["x"] for backend in ("interpreted", "compiled")
    )
    np.testing.assert_allclose(first, second, rtol=1e-10)


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ({"joint": "elbow", "at": 1}, r"actuators\.f\.joint: no joint 'elbow'; .*joint_1"),
        ({"joint": "joint_1"}, r"actuators\.f\.at: missing"),
        ({"joint": "joint_1", "at": -1}, r"actuators\.f\.at: found -1, allowed: 0 or above|at least 0"),
        ({"joint": "joint_1", "at": 1, "mode": "lost"}, r"actuators\.f\.mode: "),
        ({"joint": "joint_1", "at": 1, "remaining": 2}, r"actuators\.f\.remaining: found 2"),
    ],
)
def test_bad_input_is_one_line_at_its_place(section, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, {"robots.one.actuators": {"f": {"kind": "joint_failure"} | section}})
