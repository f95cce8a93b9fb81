"""What holds at the end, as rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.stage import Row, Stage
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import exact_directions, sparse
from spacerobot.errors import ScenarioError, near_names
from spacerobot.scenario.plan import End, Goal
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneTip
from spacerobot.section import matching

T = TypeVar("T")
AXES = "xyz"


def goal_rows(stage: Stage, name: str, goal: Goal) -> list[Row]:
    """Rows of one goal.

    Raises
    ------
    ScenarioError
        If it names what there is not.
    """
    where, scene = f"plan.goals.{name}", stage.scene
    if goal.still is not None:
        body = find_still(scene, goal, where)
        rows = list(_at_rest(stage, body))
    elif goal.joints:
        body = find_robot(scene, str(goal.robot), f"{where}.robot")
        rows = list(_posture(stage, body, goal, where))
    else:
        tip = find_tip(scene, str(goal.tip), f"{where}.tip")
        body = tip.body
        rows = list(_mated(stage, tip, goal, where) if goal.frame else _placed(stage, tip, goal))
    if goal.rests:
        rows += [
            _zero(f"rate of {scene.model.names[j]}", "rad/s or m/s", stage.v[scene.model.idx_vs[j]])
            for j in body.driven_joints
        ]
    return [Row(f"{name}: {row.name}", row.unit, row.value, row.lower, row.upper) for row in rows]


def find_tip(scene: Scene, label: str, where: str) -> SceneTip:
    """Tip by robot/tip.

    Raises
    ------
    ScenarioError
        If there is none; the near names are listed.
    """
    tips = {tip.label: tip for tip in scene.tips}
    if label not in tips:
        raise ScenarioError(f"no tip {label!r}; {near_names(label, tips)}", source=scene.source, where=where)
    return tips[label]


def find_frame(scene: Scene, frame: str, where: str) -> int:
    """Id of a link's frame of the target.

    Raises
    ------
    ScenarioError
        If there is no target, or no such link.
    """
    if scene.target is None:
        raise ScenarioError("there is no target", source=scene.source, where=where)
    links = [link.name for link in scene.target.description.links]
    if frame not in links:
        raise ScenarioError(
            f"no link {frame!r} in the target's URDF; {near_names(frame, links)}",
            source=scene.source,
            where=where,
        )
    return int(scene.model.getFrameId(f"target/{frame}", pin.FrameType.BODY))


def seen_from(stage: Stage, tip: SceneTip, frame: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Position (3x1) [m], velocity (3x1) [m/s] and spin (3x1) [rad/s] of a tip in a moving frame."""
    (rotation, origin), (velocity, spin) = stage.placement(frame), stage.velocity(frame)
    place, (speed, turn) = stage.placement(tip.frame)[1], stage.velocity(tip.frame)
    away = place - origin
    relative = speed - velocity - cross(spin, away)
    return tuple(ca.mtimes(rotation.T, value) for value in (away, relative, turn - spin))  # type: ignore[return-value]


def unit(axis: tuple[float, float, float]) -> ca.SX:
    """Sparse unit vector (3x1)."""
    return sparse(np.array(axis) / np.linalg.norm(axis))


def find_still(scene: Scene, goal: Goal, where: str) -> SceneBody:
    """Body that a goal has come to rest.

    Raises
    ------
    ScenarioError
        If there is none of that name, or its base is fixed.
    """
    bodies, name = {body.name: body for body in scene.bodies}, str(goal.still)
    if name not in bodies:
        raise ScenarioError(
            f"no body {name!r}; {near_names(name, bodies)}", source=scene.source, where=f"{where}.still"
        )
    if not bodies[name].root_joint:
        raise ScenarioError(
            f"the base of {name!r} is fixed, so it is always at rest",
            source=scene.source,
            where=f"{where}.still",
        )
    return bodies[name]


def _at_rest(stage: Stage, body: SceneBody) -> Iterator[Row]:
    """Velocity and spin of a root link, its own axes."""
    model = stage.scene.model
    first, size = int(model.idx_vs[body.root_joint]), int(model.nvs[body.root_joint])
    linear = size - (3 if size == 6 else 1)
    for k, axis in enumerate("xyz"[:linear]):
        yield _zero(f"velocity {axis}", "m/s", stage.v[first + k])
    for k, axis in enumerate("xyz" if size == 6 else "z"):
        yield _zero(f"spin {axis}", "rad/s", stage.v[first + linear + k])


def _mated(stage: Stage, tip: SceneTip, goal: Goal, where: str) -> Iterator[Row]:
    """Pose and motion of a tip relative to a mating frame."""
    scene = stage.scene
    frame = find_frame(scene, str(goal.frame), f"{where}.frame")
    place, speed, spin = seen_from(stage, tip, frame)
    axis = unit(goal.axis)
    place, speed = place + goal.standoff * axis, speed - goal.closing_speed * axis
    for i in scene.translation_axes:
        yield _zero(f"position {AXES[i]}", "m", place[i])
        yield _zero(f"velocity {AXES[i]}", "m/s", speed[i])
    if not goal.orientation:
        return
    mated = exact_directions(pin.rpy.rpyToMatrix(np.radians(goal.mated_deg)))
    turn = stage.turned(ca.mtimes(stage.placement(frame)[0], mated), stage.placement(tip.frame)[0])
    for k, i in enumerate(scene.rotation_axes):
        yield _zero(f"orientation {AXES[i]}", "rad", turn[k])
        yield _zero(f"spin {AXES[i]}", "rad/s", spin[i])


def _placed(stage: Stage, tip: SceneTip, goal: Goal) -> Iterator[Row]:
    """Pose of a tip in the world."""
    scene, (rotation, place) = stage.scene, stage.placement(tip.frame)
    for i in scene.translation_axes:
        yield _zero(f"position {AXES[i]}", "m", place[i] - (goal.position or (0.0, 0.0, 0.0))[i])
    if goal.rotation_deg is not None:
        wanted = exact_directions(pin.rpy.rpyToMatrix(np.radians(goal.rotation_deg)))
        turn = stage.turned(wanted, rotation)
        for k, i in enumerate(scene.rotation_axes):
            yield _zero(f"orientation {AXES[i]}", "rad", turn[k])


def _posture(stage: Stage, body: SceneBody, goal: Goal, where: str) -> Iterator[Row]:
    """Positions of joints."""
    for name, joint, end in joints_named(stage.scene, body, goal.joints, f"{where}.joints"):
        yield _joint_row(stage, name, joint, end)


def joints_named(
    scene: Scene, body: SceneBody, given: Mapping[str, T], where: str
) -> Iterator[tuple[str, int, T]]:
    """Name and number of each joint of a body that a pattern names, and what is given for it.

    Raises
    ------
    ScenarioError
        If a pattern names none.
    """
    ids = {body.joint_name(scene.model, j): j for j in body.driven_joints}
    for pattern, each in given.items():
        names = matching(ids, pattern)
        if not names:
            raise ScenarioError(
                f"no joint {pattern!r}; {near_names(pattern, ids)}", source=scene.source, where=where
            )
        for name in names:
            yield name, ids[name], each


def _joint_row(stage: Stage, name: str, joint: int, end: End) -> Row:
    pin_joint = stage.scene.model.joints[joint]
    wanted = float(np.radians(end.angle_deg or 0.0)) + (end.offset or 0.0)
    q = stage.q[pin_joint.idx_q]
    if pin_joint.nq == 2:  # an unbounded joint: the angle that is left
        s = stage.q[pin_joint.idx_q + 1]
        c, d = float(np.cos(wanted)), float(np.sin(wanted))
        return _zero(f"angle of {name}", "rad", ca.atan2(s * c - q * d, q * c + s * d))
    return _zero(f"position of {name}", "rad or m", q - wanted)


def find_robot(scene: Scene, name: str, where: str) -> SceneBody:
    """Robot by its name.

    Raises
    ------
    ScenarioError
        If there is none; the near names are listed.
    """
    robots = {body.name: body for body in scene.robots}
    if name not in robots:
        raise ScenarioError(
            f"no robot {name!r}; {near_names(name, robots)}", source=scene.source, where=where
        )
    return robots[name]


def _zero(name: str, unit_name: str, value: ca.SX) -> Row:
    return Row(name, unit_name, value, 0.0, 0.0)
