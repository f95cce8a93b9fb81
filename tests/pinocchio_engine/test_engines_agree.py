"""The right-hand sides and outputs of the two engines at random states, for everything the schema offers."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import ARM_SIGNALS, PLANAR, SPATIAL, random_x, small_scene

ONE, TWO = "robots.one.tips.tip", "robots.two.tips.tip"
TURNING = {"kp": 3, "ki": 2, "kd": 0.7}
SENSORS = {
    name: {"offset": 0.01 * (i + 1), "scale": 1 + 0.03 * (i - 2)} for i, name in enumerate(ARM_SIGNALS)
}
SPLINE = {
    "kind": "spline",
    "times": [0, 0.4, 1.1, 1.6],
    "displacements": [[0, 0, 0], [0.1, 0, 0], [0.05, 0.1, 0], [0, 0, 0]],
}
SPATIAL_SPLINE = SPLINE | {"displacements": [[0, 0, 0], [0.1, 0, -0.05], [0.05, 0.1, 0.1], [0, 0, 0.2]]}
TARGET_LINE = {"kind": "line", "displacement": [0.1, -0.05, 0], "rotation_deg": [0, 0, 25], "duration": 1.5}
TARGET_CIRCLE = {"kind": "circle", "radius": 0.1, "rotation_deg": [20, -10, 15], "duration": 1.5}


def grasp(kind: str, tip: str, frame: str, **more: object) -> dict[str, object]:
    return {"kind": kind, "tip": tip, "frame": frame} | more


TURNED_SPRING = {"grasps.*.rotational_stiffness": 4, "grasps.*.rotational_damping": 0.6}
AT_REST = {
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "target.base.spin_deg": [0, 0, 0],
    "robots.*.joints.*.rate_deg": 0,
}
AT_REST_SPATIAL = {key: value for key, value in AT_REST.items() if "joints" not in key} | {
    f"robots.one.joints.{joint}": value
    for joint, value in {
        "slant.rate_deg": 0,
        "slide.speed": 0,
    }.items()
}

CASES = {
    "plain": (PLANAR, {}),
    "inertial, filtered": (PLANAR, {f"{ONE}.pid.feedback": "inertial", f"{TWO}.pid.derivative": "filtered"}),
    "filtered inertial, amnesia off": (
        PLANAR,
        {
            "robots.*.tips.tip.pid.feedback": "inertial",
            f"{ONE}.pid.derivative": "filtered",
            f"{ONE}.amnesia": None,
        },
    ),
    "orientation": (
        PLANAR,
        {
            "robots.*.tips.tip.orientation_pid": TURNING,
            f"{TWO}.orientation_pid.feedback": "inertial",
            f"{ONE}.orientation_pid.derivative": "filtered",
            "robots.*.tips.tip.orientation_amnesia": {"ge": 20, "ta": 3},
            f"{TWO}.reference.rotation_deg": [0, 0, 30],
        },
    ),
    "joint PD, its null space": (
        PLANAR,
        {
            "robots.*.joint_pd": {"kp": 9, "kd": 2},
            "robots.two.joint_pd.null_space": True,
            f"{ONE}.orientation_pid": TURNING,
        },
    ),
    "null space of every kind of channel": (
        PLANAR,
        {
            "robots.*.joint_pd": {"kp": 9, "kd": 2, "null_space": True, "ik_rate": 3, "ik_damping": 0.1},
            f"{ONE}.pid.feedback": "inertial",
            f"{TWO}.pid.derivative": "filtered",
            "robots.*.sensors": SENSORS,
        },
    ),
    "joint PD alone": (
        PLANAR,
        {
            "robots.*.joint_pd": {"kp": 9, "kd": 2, "null_space": True},
            "robots.*.tips.tip.amnesia": None,
            "robots.*.tips.tip.pid": None,
        },
    ),
    "sensors": (
        PLANAR,
        {
            "robots.*.sensors": SENSORS,
            f"{ONE}.orientation_pid": TURNING,
            f"{ONE}.orientation_amnesia": {"ge": 20, "ta": 3},
            f"{TWO}.pid.feedback": "inertial",
            f"{TWO}.pid.derivative": "filtered",
            f"{TWO}.amnesia": {"ge": 30, "ta": 1},
            f"{TWO}.orientation_pid": TURNING | {"feedback": "inertial"},
        },
    ),
    "torque limits": (
        PLANAR,
        {
            "robots.*.torque_limits": True,
            "robots.*.joints.*.torque_limit": 3,
            "robots.one.joint_pd": {"kp": 9},
        },
    ),
    "spline and hold": (PLANAR, {f"{ONE}.reference": SPLINE, f"{TWO}.reference": {"kind": "hold"}}),
    "derived from the target": (
        PLANAR,
        {"robots.*.tips.tip.reference": None, "target.reference": TARGET_LINE},
    ),
    "springs that turn": (PLANAR, TURNED_SPRING | {f"{ONE}.orientation_pid": TURNING}),
    "weld and spring": (
        PLANAR,
        AT_REST | {"grasps.left": grasp("weld", "one/tip", "mate_1"), f"{ONE}.orientation_pid": TURNING},
    ),
    "two points, torque limits": (
        PLANAR,
        AT_REST
        | {
            "grasps.left": grasp("point", "one/tip", "mate_1", stabilisation=7),
            "grasps.right": grasp("point", "two/tip", "mate_2"),
            "robots.one.torque_limits": True,
            "robots.one.joints.*.torque_limit": 4,
        },
    ),
    "gravity": (PLANAR, {"gravity": [0.3, -1.6, 0]}),
    "gravity across planar bases": (PLANAR, {"gravity": [0.1, 0, -2], f"{ONE}.orientation_pid": TURNING}),
    "a fixed and a passive robot": (
        PLANAR,
        {
            "robots.one.base": {"joint": "fixed", "rotation_deg": [0, 0, 30], "position": [0.2, 0.1, 0]},
            f"{ONE}.pid.feedback": "inertial",
            f"{TWO}.pid": None,
            "robots.one.joint_pd": {"kp": 5, "kd": 1, "null_space": True},
        },
    ),
    "spatial": (SPATIAL, {}),
    "spatial orientation, sensors": (
        SPATIAL,
        {
            "robots.*.sensors": SENSORS,
            "robots.*.tips.tip.orientation_pid": TURNING,
            "robots.*.tips.tip.orientation_amnesia": {"ge": 20, "ta": 3},
            f"{ONE}.orientation_pid.feedback": "inertial",
            f"{ONE}.pid.feedback": "inertial",
            f"{TWO}.orientation_pid.derivative": "filtered",
            f"{TWO}.pid.derivative": "filtered",
        },
    ),
    "spatial joint PD, limits": (
        SPATIAL,
        {
            "robots.*.joint_pd": {"kp": 6, "kd": 1},
            "robots.two.joint_pd.null_space": True,
            "robots.*.torque_limits": True,
            "robots.*.joints.wrist.torque_limit": 0.5,
            f"{ONE}.orientation_pid": TURNING,
        },
    ),
    "spatial, derived from the target, gravity": (
        SPATIAL,
        TURNED_SPRING
        | {
            "robots.*.tips.tip.reference": None,
            "target.reference": TARGET_CIRCLE,
            "gravity": [0.2, 0.5, -3],
            f"{ONE}.orientation_pid": TURNING,
        },
    ),
    "spatial weld and point": (
        SPATIAL,
        AT_REST_SPATIAL
        | {
            "target.joints.hinge.rate_deg": 3,
            "grasps.left": grasp("weld", "one/tip", "left", stabilisation=9),
            "grasps.right": grasp("point", "two/tip", "right"),
            f"{ONE}.reference": SPATIAL_SPLINE,
        },
    ),
    "a fixed target held by a weld": (
        SPATIAL,
        AT_REST_SPATIAL
        | {
            "target.base": {"joint": "fixed", "position": [1, 0, 0.2], "rotation_deg": [0, 20, 0]},
            "robots.one.base": {"joint": "free_flyer", "close_grasp": "left"},
            "grasps.left": grasp("weld", "one/tip", "left"),
        },
    ),
    "tips on the base link": (
        PLANAR,
        {
            "robots.two.tips.hub": {"frame": "base", "pid": {"kp": 3, "kd": 1, "feedback": "inertial"}},
            "robots.two.joint_pd": {"kp": 2, "ik_damping": 0.2},
        },
    ),
    "two tips, mixed bases": (
        SPATIAL,
        {
            "robots.one.base": {"joint": "fixed", "rotation_deg": [10, 0, 0], "position": [0, 0, 0.3]},
            "robots.one.tips.elbow": {"pid": {"kp": 4, "kd": 1, "feedback": "inertial"}},
            f"{ONE}.pid": {"kp": 5, "kd": 2},
            "robots.one.joint_pd": {"kp": 3, "kd": 1},
            "robots.two.links.a.inertia": [0.06, 0.2, 0.21, -0.01, 0.02, 0.03],
            "robots.two.links.a.com": [0.1, -0.05, 0.03],
        },
    ),
}


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float, what: str) -> None:
    """Equal relative to the largest entry (to one where all are small)."""
    assert found.shape == expected.shape, what
    assert np.array_equal(np.isnan(found), np.isnan(expected)), what
    found, expected = np.nan_to_num(found), np.nan_to_num(expected)
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    assert np.abs(found - expected).max(initial=0.0) <= tolerance * scale, what


def assert_engines_agree(scene, times, tolerance=1e-10):
    loop, engine, rng = build_closed_loop(scene), PinocchioLoop(scene), np.random.default_rng(3)
    x0, c = (part.full().ravel() for part in loop.setup(loop.parameter_values))
    assert loop.state_names[loop.nq + loop.nv :] == engine.state_names
    assert_close(engine.x0, x0, 1e-13, "initial state")
    for t in times:
        x = random_x(scene, rng, loop.nx)
        shown = loop.at(t, x, c)
        rate, found = loop.dynamics(t, x, shown).full().ravel(), engine.derivative(t, x)
        for part, a, b in zip("qvz", engine.split(found), engine.split(rate), strict=True):
            assert_close(a, b, tolerance, f"rate of {part} at {t} s")
        outputs = dict(zip(loop.outputs.name_out(), loop.outputs(t, x, shown), strict=True))
        seen = engine.outputs(t, x)
        assert list(seen) == list(outputs)
        for name, values in outputs.items():
            assert_close(seen[name], values.full().ravel(), tolerance, f"{name} at {t} s")


@pytest.mark.parametrize("case", CASES)
def test_engines_agree_at_random_states(case):
    text, changes = CASES[case]
    assert_engines_agree(small_scene(text, changes), (0.0, 0.7, 1.45, 3.0))


@pytest.mark.parametrize("name", ["paper", "servicer"])
def test_engines_agree_on_shipped_scenes(name):
    assert_engines_agree(load_scene(name), (0.0, 4.3, 16.0), tolerance=1e-9)


def test_at_the_end_of_a_reference_both_take_what_holds_afterwards():
    scene = small_scene(PLANAR)
    loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
    c, x = loop.setup(loop.parameter_values)[1], engine.x0
    for t in engine.breakpoints:
        after = loop.dynamics(t, x, c).full().ravel()
        before = loop.dynamics(t * (1 - 1e-12), x, c).full().ravel()
        assert_close(engine.derivative(t, x), after, 1e-10, "at")
        assert_close(engine.derivative(t, x, within=t - 0.1), before, 1e-8, "led up to")
        assert np.abs(after - before).max() > 1e-3
    assert loop.breakpoints == engine.breakpoints
