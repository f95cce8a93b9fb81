"""Checks of a scene: mass properties before it is built; planarity, gaps, grasps and elements afterwards."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError, ScenarioError, near_names
from spacerobot.description.bodies import RigidBody, check_bodies, welded_bodies
from spacerobot.description.flexible import find_link
from spacerobot.description.parts import UrdfLink
from spacerobot.description.read import Description
from spacerobot.elements import Actuator, RobotElement, RobotProperties, kinds
from spacerobot.elements.estimators.estimator import HELD_INERTIA
from spacerobot.scenario import Robot, Scenario, Target
from spacerobot.scene.configure import relative_jacobian
from spacerobot.scene.grasp_closing import begun, find_closings, is_rigid
from spacerobot.scene.resolve import position
from spacerobot.scene.scene import Scene, SceneBody, SceneGrasp

MOST_VELOCITIES = 300
"""Maximum number of velocities: Pinocchio's ``Data`` takes 32 bytes times its cube, 0.9 GB at this limit."""
AXIS_TOLERANCE = 1e-9
ALIGNED = 1e-6  # [rad] that the axes of an aligned grasp may differ
SHARE_TOLERANCE = 1e-9  # of a flexible link's mass, by which more may move than it has
PIVOT_TOLERANCE = 1e-10  # of a joint's inertia, left when everything behind it gives way


def check_masses(scenario: Scenario, descriptions: Mapping[str, Description], *, source: Path | None) -> None:
    """Check that mass properties make no body singular.

    Raises:
        ScenarioError: If they do; names the link.
    """
    for path, description in descriptions.items():
        config = scenario.target if path == "target" else scenario.robots[path.removeprefix("robots.")]
        if config is None:
            continue
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                bodies = resolved_bodies(config, description)
                check_bodies(bodies, description.path, floating=config.base.joint != "fixed")
        except DescriptionError as fault:
            message, link_name = f"{fault.where} {fault.message}", str(fault.where).partition("'")[2]
            # pieces of a flexible link are called NAME_...; the section, not the URDF, gives them no mass
            flexing = [f"flexible.{name}" for name in config.flexible if link_name.startswith(f"{name}_")]
            place = flexing[0] if flexing else "links"
            raise ScenarioError(message, source=source, where=f"{path}.{place}") from None
        moved: dict[str, Array] = {}
        for name in config.flexible:
            # the moving part of a flexible link must not exceed the link: the remainder must be
            # semidefinite
            flexible = config.flexible[name]
            carrier = flexible.carrier(name)
            link = _with_masses(find_link(description, carrier), config.links.get(carrier))
            spatial = pin.Inertia(link.mass, link.com, np.zeros((3, 3))).matrix()
            spatial[3:, 3:] += link.inertia
            # including the parts that other sections subtract from the same link
            moving = moved.get(carrier, 0.0) + flexible.moving_inertia(description, name)
            moved[carrier] = moving
            scale = np.sqrt(np.maximum(np.diag(spatial), np.diag(moving)))
            scale[scale == 0] = 1.0
            values, vectors = np.linalg.eigh((spatial - moving) / np.outer(scale, scale))
            if values[0] < -SHARE_TOLERANCE:
                part = int(np.argmax(np.abs(vectors[:, 0])))
                motion, way = f"{('along', 'about')[part // 3]} {'xyz'[part % 3]}", vectors[:, 0] / scale
                share = float(way @ moving @ way) / max(float(way @ spatial @ way), np.finfo(float).tiny)
                raise ScenarioError(
                    f"more moves than link {carrier!r} has, mostly {motion}: found {share:.4g} times its "
                    "inertia, allowed: once; lower what moves, or give the link more mass or inertia by "
                    "`links`",
                    source=source,
                    where=f"{path}.flexible.{name}",
                )


def resolved_bodies(config: Robot | Target, description: Description) -> list[RigidBody]:
    """Bodies that move as one, the base first, with the mass properties of a resolved scenario."""
    resolved_links = [_with_masses(link, config.links.get(link.name)) for link in description.links]
    return welded_bodies(resolved_links, description.joints, description.root)


def _with_masses(link: UrdfLink, mass_properties: Any) -> UrdfLink:
    """Link with the mass properties of the resolved scenario."""
    if mass_properties is None:
        return link
    ixx, iyy, izz, ixy, ixz, iyz = mass_properties.inertia
    inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return dataclasses.replace(
        link, mass=mass_properties.mass, com=np.array(mass_properties.com), inertia=inertia
    )


def check_motion(model: Any, *, source: Path | None) -> None:
    """Check that the scene has joints, and not too many.

    Raises:
        ScenarioError: If there is no joint at all, or more velocities than fit in Pinocchio's memory.
    """
    if model.nv == 0:
        raise ScenarioError(
            "nothing can move: every base is fixed and no URDF has a moving joint", source=source
        )
    if model.nv > MOST_VELOCITIES:
        raise ScenarioError(
            f"has {model.nv} velocities, allowed are {MOST_VELOCITIES}: Pinocchio's memory grows with their "
            "cube, 1 GB there; lock joints by `joints: {NAME: {locked: true}}`",
            source=source,
        )


def check_inertia(scene: Scene) -> None:
    """Check that every joint moves some inertia in the initial posture.

    Massless links are allowed between the joints of a chain, except between two joints about the same line,
    where they could rotate freely.

    Raises:
        ScenarioError: If a joint moves no inertia; names the joints.
    """
    model, spread = scene.model, scene.spread
    upper = np.triu(pin.crba(model, model.createData(), scene.q))
    inertia = spread.T @ (upper + np.triu(upper, 1).T) @ spread
    carried = np.diag(inertia).copy()
    loose = []
    for joint in range(model.njoints - 1, 0, -1):  # from the leaves, as the articulated-body algorithm goes
        for k in reversed(range(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])):
            if spread[k, k] == 0:
                continue
            if inertia[k, k] <= PIVOT_TOLERANCE * carried[k]:
                loose.append(str(model.names[joint]))
                break
            inertia[:k, :k] -= np.outer(inertia[:k, k], inertia[k, :k]) / inertia[k, k]
    if loose:
        raise ScenarioError(
            f"nothing with inertia resists the motion of {', '.join(reversed(loose))} in the initial "
            "posture; give links mass and inertia, lock joints by `locked: true`, or begin elsewhere",
            source=scene.source,
        )


def is_planar(model: Any, bodies: Sequence[SceneBody], q: Array) -> bool:
    """Whether every joint keeps its body in a plane parallel to the world's x-y plane."""
    if abs(model.gravity.linear[2]) > 0:
        return False
    if any(body.base.joint == "free_flyer" for body in bodies):
        return False
    data = model.createData()
    jacobian = pin.computeJointJacobians(model, data, q).reshape(6, -1)  # of one column, a vector comes
    for body in bodies:
        for j in body.joints:
            column = jacobian[:, model.joints[j].idx_v]
            turns = bool(np.linalg.norm(column[3:]) > AXIS_TOLERANCE)
            # a revolute axis must be upright; a prismatic one must lie in the plane
            if np.linalg.norm(column[3:5]) > AXIS_TOLERANCE or (
                not turns and abs(column[2]) > AXIS_TOLERANCE
            ):
                return False
    return True


def gap(model: Any, grasp: SceneGrasp, q: Array) -> Array:
    """Vector from mating frame to tip, world axes (3,) [m]."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return np.array(data.oMf[grasp.tip.frame].translation - data.oMf[grasp.frame].translation)


def check_gaps(scene: Scene) -> None:
    """Check that the tip of each closed grasp is at its mating frame.

    Raises:
        ScenarioError: If a gap is too large; states the gap, the allowed one and how to close it.
    """
    following = {closing.body.name for closing in find_closings(scene.bodies, scene.grasps)}
    for grasp in begun(scene.grasps):
        distance = float(np.linalg.norm(gap(scene.model, grasp, scene.q)))
        if distance > grasp.config.max_gap:
            ends = [body for body in scene.bodies if body.name in ("target", grasp.tip.body.name)]
            follows = any(body.root_joint and body.name not in following for body in ends)
            can_follow = follows and not is_rigid(grasp)  # a rigid one would have moved the base
            way = f"place a base by `close_grasp: {grasp.name}` or " if can_follow else ""
            raise ScenarioError(
                f"does not close: {grasp.tip.label} is {distance:.4g} m from {grasp.config.frame}, allowed "
                f"max_gap {grasp.config.max_gap:g} m; {way}change the posture",
                source=scene.source,
                where=grasp.path,
            )


def check_alignment(scene: Scene) -> None:
    """Check that each base can rotate as its grasp's alignment requires.

    Raises:
        ScenarioError: If a planar base would have to tilt; states the remaining angle.
    """
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    for closing in find_closings(scene.bodies, scene.grasps):
        if not closing.aligns:
            continue
        grasp, base = closing.grasp, closing.body.base
        actual = data.oMf[grasp.frame].rotation.T @ data.oMf[grasp.tip.frame].rotation
        desired = pin.rpy.rpyToMatrix(np.radians(base.align_rotation_deg))
        remaining_angle = float(np.linalg.norm(pin.log3(desired.T @ actual)))
        if remaining_angle > ALIGNED:
            raise ScenarioError(
                f"cannot align grasp {grasp.name!r}: a {base.joint} base turns about z alone, and the axes "
                f"of {grasp.tip.label} and {grasp.config.frame} remain tilted by "
                f"{np.degrees(remaining_angle):.4g} deg; use `joint: free_flyer` or another posture",
                source=scene.source,
                where=f"{closing.body.path}.base.align",
            )


def check_rank(scene: Scene) -> None:
    """Check that rigid grasps do not constrain the same freedom twice.

    Raises:
        ScenarioError: If they do; names the grasps.
    """
    rigid = [grasp for grasp in begun(scene.grasps) if is_rigid(grasp)]
    if not rigid:
        return
    stacked = np.vstack([relative_jacobian(scene, grasp) for grasp in rigid]) @ scene.spread
    rank = int(np.linalg.matrix_rank(stacked, tol=1e-8 * np.linalg.norm(stacked)))
    if rank < len(stacked):
        names = ", ".join(grasp.name for grasp in rigid)
        raise ScenarioError(
            f"the rigid grasps {names} fix {len(stacked)} freedoms of which only {rank} are independent in "
            "the initial posture; use `kind: point` or `compliant` for one of them, or another posture",
            source=scene.source,
            where="grasps",
        )


def check_elements(scene: Scene) -> None:
    """Check every controller, actuator and estimator against the robot that it acts on.

    Raises:
        ScenarioError: With path and message of the element that does not fit.
    """
    for body, path, element in robot_elements(scene):
        for key, message in element.faults(robot_facts(scene, body)):
            where = f"{path}.{key}" if key else path
            raise ScenarioError(message, source=scene.source, where=where)
    for body in scene.robots:
        # elements that act on a fixed base, and controllers whose wrench on a base no actuator delivers
        elements = [entry for entry in robot_elements(scene) if entry[0] is body]
        delivered = {
            part
            for _, _, element in elements
            if isinstance(element, Actuator)
            for part in element.base_wrench
        }
        # unloading needs wheels listed after it; failures must come after their detection
        actuators = [(path, part) for _, path, part in elements if isinstance(part, Actuator)]
        wheels = [actuator.has_wheels for _, actuator in actuators]
        for place, (path, actuator) in enumerate(actuators):
            if actuator.unloads and (any(wheels[:place]) or not any(wheels[place:])):
                suitable_kinds = [
                    name for name, kind in kinds("actuator").items() if getattr(kind, "has_wheels", False)
                ]
                message = (
                    "unloads wheels, which must be listed after it; give some, of kind "
                    f"{' or '.join(suitable_kinds)}"
                )
                raise ScenarioError(message, source=scene.source, where=path)
            early = next((name for name, other in actuators[:place] if other.loses_torque), None)
            if actuator.detects_failures and early is not None:
                message = (
                    f"sees only failures that are listed after it; found {early} before it, list that later"
                )
                raise ScenarioError(message, source=scene.source, where=path)
        for _, path, element in elements:
            if element.own_wrench and not body.root_joint:
                message = (
                    "acts on the base, which is fixed; leave it out, or give `base: {joint: free_flyer}`"
                )
                raise ScenarioError(message, source=scene.source, where=path)
            if isinstance(element, Actuator) or element.own_wrench <= delivered:
                continue
            part = min(element.own_wrench - delivered)
            suitable_kinds = [
                name for name, kind in kinds("actuator").items() if part in getattr(kind, "base_wrench", ())
            ]
            raise ScenarioError(
                f"commands a {part} on the base, which no actuator of the robot delivers; give one of kind "
                f"{', '.join(suitable_kinds)} at {body.path}.actuators",
                source=scene.source,
                where=path,
            )
        # two estimators of one signal, and an estimator without measurements
        estimator_by_signal: dict[str, str] = {}
        estimators = body.config.estimators if isinstance(body.config, Robot) else {}
        for key, estimator in estimators.items():
            where = f"{body.path}.estimators.{key}"
            for signal in estimator.makes:
                if signal in estimator_by_signal:
                    other = estimator_by_signal[signal]
                    problem = f"estimates {signal}, which estimator {other!r} does too; leave one of them out"
                    raise ScenarioError(problem, source=scene.source, where=where)
                estimator_by_signal[signal] = key
            frames = estimator.frames()
            if frames is None:
                continue
            if scene.target is None or not scene.target.root_joint:
                problem = (
                    "found no target that moves, which it is to see; give `target`, with a base that is free"
                )
                raise ScenarioError(problem, source=scene.source, where=where)
            tips = [tip.label.rpartition("/")[2] for tip in scene.tips if tip.body is body]
            links = [link.name for link in scene.target.description.links]
            for name, field, names in zip(frames, ("tip", "frame"), (tips, links), strict=True):
                if name not in names:
                    problem = f"found {name!r}, {near_names(name, names)}"
                    raise ScenarioError(problem, source=scene.source, where=f"{where}.{field}")
            if HELD_INERTIA in estimator.makes and not any(
                (grasp.tip.label, grasp.config.frame) == (f"{body.name}/{frames[0]}", frames[1])
                and grasp.config.fixes_position
                and grasp.config.fixes_orientation
                for grasp in scene.grasps
            ):
                problem = (
                    f"found no grasp of {frames[0]} and {frames[1]} that fixes position and orientation; "
                )
                raise ScenarioError(f"{problem}give a weld", source=scene.source, where=f"{where}.frame")
    for tip in scene.tips:
        carriers = [joint for joint in tip.body.owned if joint in scene.model.supports[tip.joint]]
        if carriers:
            name = tip.body.joint_name(scene.model, carriers[0])
            raise ScenarioError(
                f"{name} carries {tip.label}, so no actuator may own it",
                source=scene.source,
                where=f"{tip.body.path}.actuators",
            )


def check_environment(scene: Scene) -> None:
    """Check that no environment pulls a planar base out of its plane: in a planar scene, none does.

    Raises:
        ScenarioError: If one does; names the base.
    """
    for body in scene.bodies if scene.scenario.environment and not scene.planar else ():
        if body.base.joint == "planar":
            raise ScenarioError(
                "found planar, allowed in an environment: free_flyer, fixed, or planar where nothing "
                "can leave the x-y plane (no base free in space, all joints in the plane)",
                source=scene.source,
                where=f"{body.path}.base.joint",
            )


def robot_elements(scene: Scene) -> Iterator[tuple[SceneBody, str, RobotElement]]:
    """Controllers and actuators of whole robots, with their dotted paths."""
    for body in scene.robots:
        if isinstance(body.config, Robot):
            for key, element in body.config.parts():
                yield body, f"{body.path}.{key}", element


def robot_facts(scene: Scene, body: SceneBody) -> RobotProperties:
    """Properties of a robot in its initial posture, for the checks of its elements."""
    free = {joint: body.joint_name(scene.model, joint) for joint in body.free_joints}
    names = tuple(free[joint] for joint in body.driven_joints)
    return RobotProperties(
        body.name,
        names,
        {name: body.config.joints[name].torque_limit for name in names},
        {joint.name: joint.effort for joint in body.description.joints},
        functools.partial(_moved, scene, body),
        {name: begin for name in names if (begin := position(body.config.joints[name])) is not None},
        body.base.joint,
        {
            name: axis
            for joint, name in free.items()
            if (axis := _spinning(scene.model, body, joint)) is not None
        },
        tuple(free[joint] for joint in body.owned),
        dict(body.config.sensors or ()) if isinstance(body.config, Robot) else {},
        tuple(tip.label.rpartition("/")[2] for tip in scene.tips if tip.body is body),
        () if scene.target is None else tuple(link.name for link in scene.target.description.links),
    )


def _spinning(model: Any, body: SceneBody, joint: int) -> Array | None:
    """Axis (3,), root link's axes, of a continuous joint on that link without further joints.

    None for others.
    """
    is_leaf = len(model.subtrees[joint]) == 1 and model.parents[joint] == body.root_joint
    if not is_leaf or model.joints[joint].nq != 2:
        return None
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, pin.neutral(model))
    axis: Array = model.jointPlacements[joint].rotation @ np.asarray(data.S).ravel()[3:]
    return axis


def _moved(scene: Scene, body: SceneBody) -> Array:
    """Jacobian (directions, joints) from the driven joints' rates to the tips' controlled directions."""
    data = scene.model.createData()
    pin.computeJointJacobians(scene.model, data, scene.q)
    pin.updateFramePlacements(scene.model, data)
    rows = [np.empty((0, scene.model.nv))]
    for tip in scene.tips:
        if tip.body is body:
            world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            jacobian = pin.getFrameJacobian(scene.model, data, tip.frame, world)
            for key, controller in tip.config.elements():
                motion = controller.controls(key)
                if motion == "translation":
                    rows.append(jacobian[:3][list(scene.translation_axes)])
                elif motion == "rotation":
                    rows.append(jacobian[3:][list(scene.rotation_axes)])
    columns = [scene.model.idx_vs[joint] for joint in body.driven_joints]
    moved: Array = (np.vstack(rows) @ scene.spread)[:, columns]
    return moved
