"""Thrusters: how a wrench is shared, what pulses give, and what they spend."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate as pinocchio_simulate
from spacerobot.pinocchio_engine import simulate as second
from tests.oracles.hybrid import roll
from tests.oracles.small_scenes import small_scene
from tests.pinocchio_engine.test_dockings import hold_together

NOZZLES = """
          a: {position: [0.3, 0.2, 0], direction: [-1, 0, 0]}
          b: {position: [0.3, -0.2, 0], direction: [-2, 0, 0]}
          c: {position: [-0.3, 0.2, 0], direction: [1, 0, 0]}
          d: {position: [-0.3, -0.2, 0], direction: [1, 0, 0]}
          e: {position: [0.3, 0, 0], direction: [0, -1, 0]}
          f: {position: [-0.3, 0, 0], direction: [0, -1, 0]}
          g: {position: [0.3, 0, 0], direction: [0, 1, 0]}
          h: {position: [-0.3, 0, 0], direction: [0, 3, 0], thrust: 0.8}
"""
PLATE = (
    """
robots:
  one:
    urdf: plate.urdf
    base: {joint: planar, velocity: [0.05, -0.02, 0]}
    controllers:
      turn: {kind: base_attitude, kp: 1.575, kd: 2.1, attitude_deg: [0, 0, 25]}
      stay: {kind: base_position, kp: 4, kd: 8}
    actuators:
      jets:
        kind: thrusters
        thrust: 0.6
        period: 0.4
        nozzles:"""
    + NOZZLES
    + "simulation: {duration: 2, step: 0.02}\n"
)
"""A plate of 8 kg and 0.7 kg m^2 with eight thrusters."""

JETS = "robots.one.actuators.jets"
PULSED = {f"{JETS}.mode": "pulsed"}


def rolled(changes, duration_s=2.0):
    """Loop of a plate, and its rollout."""
    loop = build_closed_loop(small_scene(PLATE, changes))
    return loop, sr.build_rollout(loop, duration_s=duration_s, step_s=0.02, backend="interpreted")


@functools.cache
def healthy_run(mode):
    """Rollout of a plate whose valves all work, which no test changes."""
    return rolled({f"{JETS}.mode": mode})[1].run()


def test_throttled_thrusters_that_suffice_do_as_an_ideal_wrench_does():
    strong = {f"{JETS}.thrust": 50.0, f"{JETS}.nozzles.h.thrust": None}
    ends = [rolled(changes)[1].run() for changes in (strong, {f"{JETS}": {"kind": "base_wrench"}})]
    for name in ("base_attitude_error", "base_position_error"):
        np.testing.assert_allclose(ends[0].outputs[name], ends[1].outputs[name], atol=2e-6)


def test_what_thrusters_leave_goes_to_the_next_actuator():
    weak = {f"{JETS}.thrust": 0.01, "robots.one.actuators.rest": {"kind": "base_wrench"}}
    ends = [rolled(changes)[1].run() for changes in (weak, {f"{JETS}": {"kind": "base_wrench"}})]
    for name in ("base_attitude_error", "base_position_error"):
        np.testing.assert_allclose(ends[0].outputs[name], ends[1].outputs[name], atol=1e-9)


def test_pulses_give_their_impulse_and_spend_their_propellant():
    """A plate pushed through its centre of mass alone: thrust times on-time, as the events tell."""
    along = {"a": [-1, 0, 0], "c": [1, 0, 0], "e": [0, -1, 0], "g": [0, 1, 0]}
    nozzles = {name: {"position": [0, 0, 0], "direction": line} for name, line in along.items()}
    stay = {"kind": "base_position", "kp": 4, "kd": 8}
    changes = PULSED | {f"{JETS}.nozzles": nozzles, "robots.one.controllers": {"stay": stay}}
    loop, rollout = rolled(changes)
    run = rollout.run()
    on_time, since = dict.fromkeys(along, 0.0), {}
    for event in run.events:
        rule = loop.events[event.event]
        if rule.kind == "control":
            since = dict.fromkeys(along, event.time_s) | since
        else:
            name = rule.name.partition(".")[2].partition(".")[0]
            on_time[name] += event.time_s - since.pop(name)
    for name, begun in since.items():
        on_time[name] += run.time[-1] - begun
    given = sum(0.6 * on_time[name] * np.array(line) for name, line in along.items())
    gained = run.outputs["momentum_linear"][-1] - run.outputs["momentum_linear"][0]
    assert np.abs(given).max() > 0.1
    np.testing.assert_allclose(gained, given, atol=1e-10)
    spent = 0.6 * sum(on_time.values()) / (9.80665 * 220)
    np.testing.assert_allclose(run.outputs["propellant"][-1], [spent], rtol=1e-9)


def test_on_times_keep_to_the_shortest_pulse_and_to_steps():
    loop, rollout = rolled(PULSED | {f"{JETS}.minimum_on_time": 0.05, f"{JETS}.resolution": 0.03})
    run, begun = rollout.run(), 0.0
    for event in run.events:
        if loop.events[event.event].kind == "control":
            begun = event.time_s
            continue
        on = event.time_s - begun
        assert on < 1e-11 or on > 0.05 - 1e-11
        assert on < 1e-11 or abs(on - 0.05) < 1e-11 or abs(on / 0.03 - round(on / 0.03)) < 1e-9
    assert len(run.events) > 20


def test_pulses_agree_with_scipys_root_finding():
    loop, rollout = rolled(PULSED, 0.8)
    own, other = rollout.run(), roll(loop, 0.8)
    assert len(own.events) > 15
    np.testing.assert_allclose(own.state[-1], other.x, atol=1e-8)


def test_derivatives_go_through_switching_times():
    _, rollout = rolled(PULSED, 1.0)
    for path, value in ((f"{JETS}.thrust", 0.6), ("robots.one.controllers.stay.kd", 8.0)):
        found = rollout.jacobian(wrt=[path], outputs=["base_position_error"])
        step = 1e-6 * value
        ends = [rollout.run({path: value + s * step}).outputs["base_position_error"] for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        own = found.outputs["base_position_error"][..., 0]
        assert np.abs(slope).max() > 1e-4
        np.testing.assert_allclose(own, slope, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({f"{JETS}.nozzles": {}}, f"{JETS}.nozzles: "),
        ({f"{JETS}.nozzles.a.direction": [0, 0, 0]}, f"{JETS}.nozzles.a.direction: a direction is required"),
        (
            {f"{JETS}.nozzles.a.direction": [0, 0, 1]},
            f"{JETS}.nozzles.a.direction: found 1 along z; the base moves",
        ),
        ({f"{JETS}.period": 0}, f"{JETS}.period: found 0, allowed: above 0"),
        (
            {f"{JETS}.mode": "pulsed", f"{JETS}.minimum_on_time": 0.6},
            f"{JETS}.minimum_on_time: found 0.6 s, allowed: at most the `period` of 0.4 s",
        ),
        (
            {f"{JETS}.mode": "pulsed", f"{JETS}.nozzles.a.resolution": 0.8},
            f"{JETS}.nozzles.a.resolution: found 0.8 s, allowed: at most the `period` of 0.4 s",
        ),
    ],
)
def test_what_no_thruster_can_be_is_refused(change, told):
    with pytest.raises(ScenarioError) as fault:
        small_scene(PLATE, change)
    assert told in str(fault.value)
    assert "\n" not in str(fault.value)


def test_a_set_that_cannot_push_one_way_is_warned_of():
    assert not small_scene(PLATE).warnings
    told = small_scene(PLATE, {f"{JETS}.nozzles.{name}.direction": [0, -1, 0] for name in "gh"}).warnings
    assert f"{JETS}: no combination of its nozzles gives a force along y alone in the + sense" in told


def test_propellant_and_attitude_stand_in_the_summary_and_the_table():
    result = sr.simulate(small_scene(PLATE, {"simulation.duration": 0.4}), backend="interpreted")
    spent = float(result.data.propellant.sel(body="one")[-1])
    assert spent > 0
    assert result.summary["propellant_kg"] == {"one": spent}
    assert result.summary["attitude_error"]["one"]["max_deg"] == pytest.approx(25)
    rows = dict(result.headline())
    assert rows["propellant one"] == f"{spent * 1e3:.4g} g"
    assert rows["attitude error one"].startswith("at most 25 deg")
    assert list(result.data.thruster.values)[:2] == ["one/jets.a", "one/jets.b"]
    assert any("mass stays" in told for told in result.summary["assumptions"])


@pytest.mark.parametrize("mode", ["proportional", "pulsed"])
def test_momentum_less_the_impulse_given_stays(mode):
    """While the plate turns and thrusters switch."""
    run = healthy_run(mode)
    for kind in ("linear", "angular"):
        total, given = run.outputs[f"momentum_{kind}"], run.outputs[f"impulse_{kind}"]
        assert np.abs(given[-1]).max() > 0.02
        np.testing.assert_allclose(total - given, np.broadcast_to(total[0], total.shape), atol=1e-10)


UNLOADING = {
    "robots.one.base.velocity": [0, 0, 0],
    "robots.one.controllers.turn.attitude_deg": None,
    f"{JETS}.unload": {"rate": 0.5, "goal": [0, 0, 0.2]},
    "robots.one.actuators.wheels": {
        "kind": "reaction_wheels",
        "axes": [[0, 0, 1]],
        "inertia": 0.02,
        "speeds": [50.0],
    },
}
"""A wheel that holds 1 N m s at the start and shall hold 0.2."""


def test_wheels_are_unloaded_at_the_rate_while_they_hold_the_attitude():
    """h' = -k (h - h_goal), so h - h_goal falls as exp(-k t), and the base does not turn."""
    run = rolled(UNLOADING)[1].run()
    held = run.outputs["wheel_momentum"].reshape(-1, 3)[:, 2]
    np.testing.assert_allclose(held, 0.2 + 0.8 * np.exp(-0.5 * run.time), atol=1e-6)
    assert np.abs(run.outputs["base_attitude_error"]).max() < 1e-12
    given = run.outputs["impulse_angular"][:, 2]
    np.testing.assert_allclose(given, held - held[0], atol=1e-10)


def test_pulses_unload_wheels_too_and_the_wheels_take_them_up():
    run = rolled(UNLOADING | PULSED | {"simulation.duration": 4}, 4.0)[1].run()
    held = run.outputs["wheel_momentum"].reshape(-1, 3)[:, 2]
    assert abs(held[-1] - 0.2) < 0.15
    assert np.abs(run.outputs["base_attitude_error"]).max() < 1e-12


def test_unloading_without_wheels_behind_is_refused():
    wheels = UNLOADING["robots.one.actuators.wheels"]
    jets = {"kind": "thrusters", "nozzles": {"a": {"position": [0, 1, 0], "direction": [1, 0, 0]}}}
    jets |= {"unload": {"rate": 0.5}}
    for actuators in ({"jets": jets}, {"wheels": wheels, "jets": jets}):
        with pytest.raises(ScenarioError) as fault:
            small_scene(PLATE, {"robots.one.actuators": actuators})
        told = f"{JETS}: unloads wheels, which must be listed after it; give some, of kind reaction_wheels or"
        assert told in str(fault.value)


ROUNDED = PULSED | {
    f"{JETS}.minimum_on_time": 0.12,
    f"{JETS}.resolution": 0.03,
    f"{JETS}.nozzles.a.resolution": 0.0,
}


@pytest.mark.parametrize(
    "changes", [ROUNDED, UNLOADING, UNLOADING | PULSED], ids=["pulsed", "unload", "pulsed_unload"]
)
def test_the_second_engine_switches_and_unloads_alike(changes):
    """Events, states between and behind them, and outputs, among them momentum and impulse."""
    unlike = {f"{JETS}.nozzles.b.specific_impulse": 200.0}  # else some stop at once, in either order
    scene = small_scene(PLATE, changes | unlike)
    names, pulsed = hold_together(scene, 0.5, step=0.02), f"{JETS}.mode" in changes
    assert names.count("one/jets.control") == 2 * pulsed
    assert (len([name for name in names if name.endswith(".cut")]) > 8) == pulsed


@pytest.mark.parametrize("shortest", [0.0, 0.09])
def test_the_second_engine_gives_the_on_times_of_scipys_least_squares(shortest):
    """Of nozzles through the centre of mass, whose wanted force is that of a spring and a damper.

    Half of the shortest pulse and more become a whole one, longer pulses the nearest multiple of 0.03 s.
    """
    lines = {"a": [-1, 0, 0], "c": [1, 0, 0], "e": [0, -1, 0], "g": [0, 1, 0]}
    nozzles = {name: {"position": [0, 0, 0], "direction": line} for name, line in lines.items()}
    stay = {"kind": "base_position", "kp": 4, "kd": 8}
    changes = PULSED | {f"{JETS}.nozzles": nozzles, "robots.one.controllers": {"stay": stay}}
    if shortest:
        changes |= {f"{JETS}.minimum_on_time": shortest, f"{JETS}.resolution": 0.03}
    found = second(small_scene(PLATE, changes), duration_s=0.85, output_step_s=0.1, rtol=1e-9)
    decided = [event for event in found.happened if event.kind == "control"]
    assert len(decided) == 3
    matrix, first = 0.6 * np.array(list(lines.values()))[:, :2].T, decided[0].before
    for event in decided[:2]:
        place, speed = event.before[:2] - first[:2], event.before[4:6]
        parts = lsq_linear(matrix, -4 * place - 8 * speed, (0, 1), tol=1e-12).x
        parts -= np.minimum(parts, parts[[1, 0, 3, 2]])  # none against each other, which spends less
        times = 0.4 * parts
        if shortest:
            steps = np.maximum(shortest, 0.03 * np.round(times / 0.03))
            times = np.where(times < shortest / 2, 0, steps)
        cuts = [e for e in found.happened if e.kind == "cut" and 0 <= e.time_s - event.time_s < 0.4 - 1e-9]
        on = {e.who[-1]: e.time_s - event.time_s for e in cuts}
        assert len(cuts) == len(lines)
        np.testing.assert_allclose([on[name] for name in lines], times, atol=2e-6)
    total, given = found.outputs["momentum_linear"], found.outputs["impulse_linear"]
    assert np.abs(given[-1]).max() > 0.05
    np.testing.assert_allclose(total - given, np.broadcast_to(total[0], total.shape), atol=1e-9)


TURNED = """
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, rotation_deg: [30, -40, 70]}
    joints: {'*': {locked: true}}
    actuators:
      jets: {kind: thrusters, thrust: 9, unload: {rate: 0.5, goal: [0.1, 0, -0.2]}, nozzles: NOZZLES}
      wheels:
        {kind: reaction_wheels, axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], inertia: 0.02, speeds: [9, 20, -30]}
simulation: {duration: 1}
"""


def test_wheels_are_unloaded_in_the_axes_of_the_body_that_carries_them():
    """Couples about each axis of the root link take off what its wheels hold beyond the goal."""
    sides, nozzles = np.vstack([np.eye(3), -np.eye(3)]).tolist(), {}
    for k, (side, push) in enumerate((a, b) for a in sides for b in sides if not np.dot(a, b)):
        nozzles[f"n{k}"] = {"position": side, "direction": push}
    loop = build_closed_loop(small_scene(TURNED.replace("NOZZLES", str(nozzles))))
    x, c = loop.setup(loop.parameter_values)
    outputs = dict(zip(loop.outputs.name_out(), loop.outputs(0, x, c), strict=True))
    over = 0.02 * np.array([9, 20, -30]) - [0.1, 0, -0.2]
    np.testing.assert_allclose(outputs["base_torque"].full()[:, 0], -0.5 * over, atol=1e-5)


def test_pulses_take_no_room_among_the_events_of_batches():
    """More pulses than a batch has room for events, then what ends the first phase."""
    phases = {"phases": {"one": {"until": {"time": 1.9}}, "two": {}}}
    loop = build_closed_loop(small_scene(PLATE, PULSED | phases | {f"{JETS}.period": 0.04}))
    rollout = sr.build_rollout(loop, duration_s=2.0, step_s=0.04, backend="interpreted")
    batch = rollout.batch([f"{JETS}.thrust"], [[0.6], [0.61]])
    alone = rollout.run().events
    assert len(alone) > 100
    told = [event for event in alone if not loop.events[event.event].routine]
    assert [event.event for event in told] == batch.events.event[0, : len(told)].tolist()
    assert 0 < len(told) == (batch.events.event[0] >= 0).sum()


@pytest.mark.parametrize("mode", ["proportional", "pulsed"])
@pytest.mark.parametrize("opening", [0.0, 0.25, 1.0])
def test_a_stuck_valve_gives_the_same_thrust_whatever_is_asked(mode, opening):
    failure = {f"{JETS}.nozzles.a.failure": {"at": 0.71, "opening": opening}, f"{JETS}.mode": mode}
    loop, rollout = rolled(failure)
    run, healthy = rollout.run(), healthy_run(mode)
    sizes = np.linalg.norm(run.outputs["thruster_force"][:, :3], axis=-1)
    after = run.time > 0.71 + 1e-9
    np.testing.assert_allclose(sizes[after], 0.6 * opening, atol=1e-12)
    np.testing.assert_allclose(
        run.outputs["thruster_force"][~after], healthy.outputs["thruster_force"][~after], atol=1e-12
    )
    names = [loop.events[happened.event].name for happened in run.events]
    assert names.count("one/jets.a.failed") == 1
    # what pushes from outside is all that changes the momentum
    impulse = run.outputs["impulse_linear"][-1] - run.outputs["impulse_linear"][0]
    change = run.outputs["momentum_linear"][-1] - run.outputs["momentum_linear"][0]
    np.testing.assert_allclose(change, impulse, atol=1e-9)


def test_gradients_by_a_valves_failure_are_exact():
    failure = {"at": 0.713, "opening": 0.3}
    paths = [f"{JETS}.nozzles.a.failure.{key}" for key in failure]
    nominal, moved = np.array(list(failure.values())), 1e-3 * np.array([1, -1, 2, -2])
    scene = small_scene(PLATE, {f"{JETS}.nozzles.a.failure": failure})
    found = sr.gradient(scene, "base_rotation_peak", paths, backend="interpreted")
    assert found.status == "exact"
    rows = np.concatenate([nominal + moved[:, None] * one for one in np.eye(2)])
    ends = sr.batch(scene, "base_rotation_peak", dict(zip(paths, rows.T, strict=True)), backend="interpreted")
    p = ends.data.base_rotation_peak.values.reshape(2, 4).T
    expected = (8 * (p[0] - p[1]) - (p[2] - p[3])) / 12e-3
    np.testing.assert_allclose(found.data.gradient.values.ravel(), expected, rtol=1e-5)
    assert (np.abs(expected) > 1e-4).all()


def test_a_stuck_valve_is_the_same_in_both_engines():
    failure = {f"{JETS}.nozzles.a.failure": {"at": 0.31, "opening": 1.0}, f"{JETS}.mode": "pulsed"}
    rollout = rolled(failure, 1.0)[1]
    other = pinocchio_simulate(small_scene(PLATE, failure), duration_s=1.0, output_step_s=0.02)
    np.testing.assert_allclose(rollout.run().state, other.state, atol=1e-8)


STEADY = {"robots.one.controllers.turn.feed_forward": 0.0, "robots.one.controllers.stay.feed_forward": 0.0}
WRENCHES = {
    "a": [-0.6, 0, 0.12],
    "b": [-0.6, 0, -0.12],
    "c": [0.6, 0, -0.12],
    "d": [0.6, 0, 0.12],
    "e": [0, -0.6, -0.18],
    "f": [0, -0.6, 0.18],
    "g": [0, 0.6, 0.18],
    "h": [0, 0.8, -0.24],
}
"""Force and torque at full thrust, axes of the plate."""


WRENCH = np.array(list(WRENCHES.values())).T


def commanded(run):
    """Parts of the thrusters, and the wrench commanded in the plate's axes, at all samples."""
    c, s, v = run.state[:, 2], run.state[:, 3], run.state[:, 4:7]
    forces = run.outputs["thruster_force"].reshape(len(c), -1, 3)
    parts = np.linalg.norm(forces, axis=-1) / np.linalg.norm(WRENCH[:2], axis=0)
    error, turn = 4 * run.outputs["base_position_error"], 1.575 * run.outputs["base_attitude_error"][:, 2]
    along = [c * error[:, 0] + s * error[:, 1], c * error[:, 1] - s * error[:, 0], turn]
    return parts, np.column_stack(along) - np.array([8, 8, 2.1]) * v


@pytest.mark.parametrize("opening", [0.0, 0.3, 1.0])
def test_the_others_do_without_a_thruster_that_is_known_to_have_failed(opening):
    """What they give is the nearest wrench to what is missing (non-negative least squares), at least cost."""
    failure = {f"{JETS}.nozzles.a.failure": {"at": 0.51, "opening": opening, "known": True}}
    run = rolled(STEADY | failure)[1].run()
    parts, wrench = commanded(run)
    scales = 1 / np.linalg.norm(WRENCH, axis=1)
    flows = np.linalg.norm(WRENCH[:2], axis=0)
    for k in np.flatnonzero(run.time > 0.52)[::5]:
        assert parts[k, 0] == pytest.approx(opening, abs=1e-12)
        matrix, missing = scales[:, None] * WRENCH[:, 1:], scales * (wrench[k] - opening * WRENCH[:, 0])
        best = lsq_linear(matrix, missing, (0, 1), tol=1e-13).x
        np.testing.assert_allclose(matrix @ parts[k, 1:], matrix @ best, atol=1e-5)
        cheapest = linprog(flows[1:], A_eq=matrix, b_eq=matrix @ best, bounds=(0, 1))
        if cheapest.status == 0:
            assert flows[1:] @ parts[k, 1:] <= 1.01 * cheapest.fun + 1e-5


@pytest.mark.parametrize("mode", ["proportional", "pulsed"])
def test_a_turn_succeeds_if_the_allocation_knows_of_an_open_valve(mode):
    ends = {}
    for known in (True, False):
        failure = {"at": 0.5, "opening": 1.0, "known": known}
        changes = STEADY | {f"{JETS}.mode": mode, f"{JETS}.nozzles.a.failure": failure}
        run = rolled(changes, 5.0)[1].run()
        errors = run.outputs["base_position_error"][-1], run.outputs["base_attitude_error"][-1]
        ends[known] = [float(np.linalg.norm(error)) for error in errors]
    assert ends[True][0] < 0.02 < 0.1 < ends[False][0]  # m; the valve pushes for ever
    assert ends[True][1] < 0.03 < 0.06 < ends[False][1]  # rad


TEST = {"period": 0.02, "bandwidth": 20.0, "velocity_noise": 1e-5, "spin_noise": 1e-5}
TEST |= {"force_allowance": 0.02, "torque_allowance": 0.01}


FAILED = {"open": ("a", 1.0), "shut": ("a", 0.0), "other": ("h", 1.0), "none": (None, 0.0)}


def failing(nozzle, opening, **changes):
    found = STEADY | {f"{JETS}.detection": TEST} | changes
    if nozzle:
        found[f"{JETS}.nozzles.{nozzle}.failure"] = {
            "at": 0.31 if nozzle == "h" else 0.11,
            "opening": opening,
        }
    return found


@pytest.mark.parametrize(("mode", "failed"), [("proportional", one) for one in FAILED] + [("pulsed", "open")])
def test_a_failed_thruster_is_detected_by_name_and_left_out(mode, failed):
    nozzle, opening = FAILED[failed]
    changes = failing(nozzle, opening, **{f"{JETS}.mode": mode})
    if failed == "other":  # a slow lag, which passes what an opposite thruster that is shut would miss
        changes[f"{JETS}.detection.bandwidth"] = 5.0
    scene = small_scene(PLATE, changes)
    result = sr.simulate(scene, backend="interpreted")
    found = [event for event in result.summary["events"] if event["kind"] == "detected"]
    names = [event["name"] for event in found]
    valve = f"one/jets.{nozzle}.{'open' if opening else 'shut'}"
    assert names == (["one/jets.detected", valve] if nozzle else [])
    assert result.data.failures_detected.values[-1, 0] == (nozzle is not None)
    if nozzle:
        assert found[0]["time_s"] < found[1]["time_s"]
        assert found[1]["delay_s"] < 0.9
        force = result.data.thruster_residual_force.sel(body="one").values
        assert np.abs(force).max() > 0.1  # N
        after = result.data.time.values > found[1]["time_s"] + 0.05
        assert np.abs(force[after]).max() < 0.02  # it is compensated from then on


def test_both_engines_detect_the_same():
    changes = failing(*FAILED["open"])
    rollout = rolled(changes, 0.8)[1]
    other = pinocchio_simulate(small_scene(PLATE, changes), duration_s=0.8, output_step_s=0.02)
    np.testing.assert_allclose(rollout.run().state, other.state, atol=1e-8)
    assert "one/jets.a.open" in [event.name for event in other.happened]


ARMED = """
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, velocity: [0.1, 0, 0], spin_deg: [5, -8, 6], rotation_deg: [20, -30, 40]}
    joints: {slant: {rate_deg: 10}, round: {rate_deg: -15}, slide: {speed: 0.05}}
    controllers: {stay: {kind: base_position, kp: 4, kd: 8}, turn: {kind: base_attitude, kp: 2, kd: 2}}
    actuators:
      jets:
        kind: thrusters
        detection: {period: 0.002, bandwidth: 20, force_allowance: 10, torque_allowance: 10}
        nozzles:
          a: {position: [0.3, 0.2, 0], direction: [-1, 0, 0]}
          b: {position: [0.3, -0.2, 0.1], direction: [0, 1, 1]}
          c: {position: [-0.3, 0, 0.2], direction: [1, -1, 0]}
      wheels: {kind: reaction_wheels, pyramid: {}, inertia: 0.05, speeds: [20, -10, 5, 8]}
simulation: {duration: 0.3, step: 0.002}
"""


def test_the_residual_is_the_missing_wrench_whatever_arm_and_wheels_do():
    """Of a thruster that is open and hardly commanded: its whole wrench, behind the lag."""
    failure = {f"{JETS}.nozzles.b.failure": {"at": 0.0, "opening": 1.0}}
    scene = small_scene(ARMED, failure | {"simulation.output_step": 0.002})
    data = sr.simulate(scene, backend="interpreted").data
    force, torque = (data[f"thruster_residual_{key}"].sel(body="one").values for key in ("force", "torque"))
    assert np.abs(data.joint_velocity.values).max() > 0.1
    line, lag = np.array([0, 1, 1]) / np.sqrt(2), 1 - np.exp(-20 * data.time.values)
    np.testing.assert_allclose(force, np.outer(lag, line), atol=5e-3)
    np.testing.assert_allclose(torque, np.outer(lag, np.cross([0.3, -0.2, 0.1], line)), atol=5e-3)
