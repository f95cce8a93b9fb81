"""Dockings by both engines: the same events at the same times, the same states."""

import copy

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Scenario
from spacerobot.scene import build_scene
from tests.oracles.free_bodies import DEEP, ENVELOPE, FLAT, free_bodies

BASES = pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
INNER = ("reference", "clipped", "unclipped")


def both(scene, duration, step):
    """Trajectories by the casadi engine and by the pinocchio engine, each within some 1e-7."""
    loop = build_closed_loop(scene)
    steps = {"duration_s": duration, "step_s": step, "output_step_s": 0.1}
    ours = build_rollout(loop, **steps, backend="interpreted").run()
    found = simulate(scene, duration_s=duration, output_step_s=0.1, rtol=1e-8, atol=1e-10)
    return loop, ours, found


def hold_together(scene, duration, step=0.005):
    """The names of the events, once both engines agree to 1e-6 in everything."""
    loop, ours, found = both(scene, duration, step)
    return agreed(loop, ours, found, scene)


def agreed(loop, ours, found, scene):
    """The names of the events of two trajectories that agree to 1e-6 in everything."""
    told = [(f.time_s, loop.events[f.event], f) for f in ours.events]
    told = [one for one in told if one[1].kind not in INNER]
    names = [rule.name for _, rule, _ in told]
    happened = [event for event in found.happened if event.kind not in INNER]
    assert [event.name for event in happened] == names
    assert [(e.kind, e.who) for e in happened] == [(rule.kind, rule.who) for _, rule, _ in told]
    times = [event.time_s for event in happened]
    np.testing.assert_allclose(times, [time for time, *_ in told], atol=1e-6, rtol=0)
    size = scene.model.nq + scene.model.nv
    places = [loop.state_names.index(name) for name in found.state_names]
    for event, (*_, fired) in zip(happened, told, strict=True):
        for one, other in ((event.before, fired.before), (event.after, fired.after)):
            np.testing.assert_allclose(one[:size], other[:size], atol=1e-6, rtol=0)
            np.testing.assert_allclose(one[size:], other[places], atol=1e-6, rtol=1e-6)
    assert found.status == ours.status
    assert (found.ended_at_s is None) == (ours.ended_at_s is None)
    assert found.outputs.keys() == ours.outputs.keys()
    np.testing.assert_allclose(found.time, ours.time, atol=1e-12)
    for name, value in ours.outputs.items():
        np.testing.assert_allclose(found.outputs[name], value, atol=1e-6, rtol=1e-6, err_msg=name)
    return names


@BASES
@pytest.mark.parametrize("kind", ["compliant", "point", "weld"])
def test_a_grasp_is_captured_drawn_in_and_released(tmp_path, bases, kind):
    """Captures without drawing in are in the next test."""
    capture = {"distance": 0.05, "dwell": 0.05, "draw_in": 0.4}
    capture |= {"draw_in_deg": 120} if kind != "point" else {}
    grasp = {"kind": kind, "capture": capture, "release": {"at": 2.2}}
    names = hold_together(free_bodies(tmp_path, bases, grasp), 2.6)
    assert names == ["left.entered", "left.captured", "left.drawn", "left.released"]


@BASES
@pytest.mark.parametrize(
    ("grasp", "names"),
    {
        "an envelope of all limits": (
            {"kind": "weld", "capture": ENVELOPE | {"axis": [1, 0.3, 0], "mated_deg": [0, 0, 5]}},
            ["left.captured"],
        ),
        "a time": ({"kind": "point", "capture": {"at": 0.37}}, ["left.captured"]),
        "pulled off": (
            {"kind": "compliant", "stiffness": 300, "capture": {"at": 0.33}, "release": {"force": 1.5}},
            ["left.captured", "left.slipped_by_force"],
        ),
        "twisted off": (
            {
                "kind": "weld",
                "capture": {"at": 0.33, "draw_in_deg": 40},
                "release": {"torque": 1e-2},
            },
            ["left.captured", "left.slipped_by_torque"],
        ),
        "let go while drawn in": (
            {"kind": "compliant", "capture": {"at": 0.33, "draw_in": 0.05}, "release": {"at": 0.93}},
            ["left.captured", "left.released"],
        ),
    }.values(),
    ids=str,
)
def test_ways_to_close_and_to_let_go(tmp_path, bases, grasp, names):
    assert hold_together(free_bodies(tmp_path, bases, grasp), 1.4) == names


PHASES = {
    "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "end"},
    "carry": {
        "until": {"time": 0.6},
        "timeout": 1.0,
        "grasps": {"left": {"stiffness": 150}},
    },
    "part": {"releases": ["left"], "captures": [], "timeout": 0.5},
}


@BASES
def test_phases_follow_each_other_and_end(tmp_path, bases):
    grasp = {"kind": "compliant", "capture": {"distance": 0.05, "dwell": 0.05}}
    names = hold_together(free_bodies(tmp_path, bases, grasp, phases=PHASES), 3.0)
    expected = ["left.entered", "left.captured", "approach.captured", "carry.time", "left.release_commanded"]
    assert names == [*expected, "part.timeout"]


SETTLING = {
    "settled": {"settled": {"of": "target", "speed": 0.08, "spin_deg": 10, "dwell": 0.1}},
    "limit": {"limit": {"output": "grasp_gap", "of": "left", "above": 0.06}},
    "whole": {"limit": {"output": "energy_spring", "above": 0.02}},
}


@pytest.mark.parametrize("until", SETTLING.values(), ids=SETTLING)
def test_a_phase_ends_as_something_settles_or_passes_a_limit(tmp_path, until):
    phases = {"approach": {"until": until, "timeout": 2.0}, "second": {"captures": []}}
    grasp = {"kind": "compliant", "stiffness": 40, "damping": 5, "capture": {"at": 0.63}}
    names = hold_together(free_bodies(tmp_path, DEEP, grasp, phases=phases), 2.4)
    assert names


PID = {"kp": 150, "ki": 60, "kd": 20, "feedback": "inertial"}
LED = {
    "name": "led",
    "robots": {
        "arm": {
            "urdf": "planar_arm.urdf",
            "base": {"joint": "planar", "position": [-0.5, 0, 0]},
            "joints": {f"joint_{i}": {"angle_deg": 40 if i < 5 else -40} for i in range(1, 9)},
            "tips": {"tip": {"pid": PID, "amnesia": {"ge": 4, "ta": 3}}},
            "joint_pd": {"kp": 0, "kd": 4},
        }
    },
    "target": {
        "urdf": "rectangle.urdf",
        "base": {
            "joint": "planar",
            "position": [0.88, 1.84, 0],
            "velocity": [0.01, 0.01, 0],
            "spin_deg": [0, 0, 2],
        },
    },
    "grasps": {"hand": {"tip": "arm/tip", "frame": "mate_1", "begins": "open", "capture": {"at": 0.63}}},
    "phases": {
        "come": {
            "robots": {"arm": {"tips": {"tip": {"reference": {"kind": "rendezvous", "frame": "mate_1"}}}}},
            "until": {"captured": ["hand"]},
        },
        "stop": {
            "target": {"reference": {"kind": "brake", "deceleration": 0.2, "spin_deceleration_deg": 8}},
            "robots": {"arm": {"tips": {"tip": {"pid": {"kp": 300, "feedback": "base"}}}}},
            "until": {"time": 0.32},
        },
        "carry": {
            "target": {"reference": {"kind": "circle", "radius": 0.01, "duration": 0.25}},
            "begins_at": "reference",
            "until": {"time": 0.3},
            "reset": True,
        },
        "part": {
            "releases": ["hand"],
            "captures": [],
            "robots": {
                "arm": {
                    "joint_pd": None,
                    "tips": {
                        "tip": {"reference": {"kind": "line", "displacement": [-0.01, 0, 0], "duration": 0.2}}
                    },
                }
            },
        },
    },
    "simulation": {"duration": 1.5, "step": 0.005},
}


def test_references_numbers_and_feedback_differ_by_phase():
    document = copy.deepcopy(LED)
    document["grasps"]["hand"]["kind"] = "weld"
    reference = document["phases"]["come"]["robots"]["arm"]["tips"]["tip"]["reference"]
    reference |= {"standoff": 0.1, "approach_time": 0.27, "duration": 0.6}
    scene = build_scene(Scenario.model_validate(document))
    names = hold_together(scene, 1.5, step=0.0025)
    assert names == ["hand.captured", "come.captured", "stop.time", "carry.time", "hand.release_commanded"]


@BASES
def test_a_target_is_pushed_away_and_captured_later(tmp_path, bases):
    pads = {
        "nose": {"link": "one/tip", "kind": "sphere", "radius": 0.05},
        "side": {"link": "target/mate", "kind": "sphere", "radius": 0.03},
        "hook": {"link": "one/tip", "kind": "sphere", "radius": 0.05, "position": [0.17, 0, 0]},
    }
    bump = {"stiffness": 4000, "exponent": 2, "dissipation": 40, "friction": 0.2, "slip_velocity": 0.01}
    contacts = {
        "bump": {"between": ["nose", "side"], **bump},
        "slip": {"between": ["hook", "side"], **bump, "may_overlap": True},
    }
    grasp = {"kind": "compliant", "capture": {"at": 2.3}}
    names = hold_together(free_bodies(tmp_path, bases, grasp, pads=pads, contacts=contacts), 2.5)
    assert names[:3] == ["slip.touched", "slip.loosened", "slip.parted"]
    assert names[3:5] == ["bump.touched", "bump.parted"]
    assert names[-1] == "left.captured"


def caught_by_two(folder):
    """A body that two others, free as well, are welded to at one instant."""
    other = {"position": [0.5, -0.9, 0.1], "rotation_deg": [0, 20, 90], **DEEP["base"]}
    bases = {"one": DEEP["base"], "two": other}
    chaser = {"urdf": "chaser.urdf", "tips": {"tip": {}}}
    robots = {name: {"base": base, **chaser} for name, base in bases.items()}
    weld = {"frame": "mate", "begins": "open", "kind": "weld", "capture": {"at": 0.4}}
    grasps = {name: {"tip": f"{robot}/tip", **weld} for name, robot in (("left", "one"), ("right", "two"))}
    return free_bodies(folder, DEEP, weld, robots=robots, grasps=grasps)


def rigid_motion(scene, x):
    """Momentum about the origin (6,), inertia (6, 6) of all bodies as one, energy [J], velocities (n, 6)."""
    model, data = scene.model, scene.model.createData()
    pin.forwardKinematics(model, data, x[: model.nq], x[model.nq : model.nq + model.nv])
    moving = [j for j in range(1, model.njoints) if model.inertias[j].mass > 0]
    whole = sum((data.oMi[j].act(model.inertias[j]).matrix() for j in moving), np.zeros((6, 6)))
    momentum = sum(data.oMi[j].act(model.inertias[j] * data.v[j]).vector for j in moving)
    energy = sum(data.v[j].vector @ model.inertias[j].matrix() @ data.v[j].vector / 2 for j in moving)
    return momentum, whole, energy, np.array([data.oMi[j].act(data.v[j]).vector for j in moving])


def test_two_rigid_grasps_captured_at_one_instant_are_one_impact(tmp_path):
    scene = caught_by_two(tmp_path)
    loop, ours, found = both(scene, 0.7, 0.01)
    assert agreed(loop, ours, found, scene) == ["left.captured", "right.captured"]
    first, last = ours.events
    assert first.time_s == last.time_s
    momentum, whole, energy, _ = rigid_motion(scene, first.before)
    together = np.linalg.solve(whole, momentum)
    after, _, left, motions = rigid_motion(scene, last.after)
    largest = np.abs(ours.outputs["body_momentum_linear"]).max()
    np.testing.assert_allclose(after, momentum, atol=1e-12 * largest)
    np.testing.assert_allclose(motions, np.tile(together, (3, 1)), atol=1e-12)
    booked = ours.outputs["work_event"][-1, 0]
    assert energy - left == pytest.approx(booked, rel=1e-10)
    assert left == pytest.approx(momentum @ together / 2, rel=1e-12)
