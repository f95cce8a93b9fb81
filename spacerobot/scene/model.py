"""Pinocchio model of the whole scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.description.read import Description
from spacerobot.scenario import Robot, Scenario, Target
from spacerobot.scene.scene import MimicJoint, SceneBody

ROOT = "root"
"""Name, after the body's prefix, of the joint of a floating base; ``root_`` if the URDF has a ``root``."""


def build_model(
    scenario: Scenario, descriptions: Mapping[str, Description]
) -> tuple[Any, tuple[SceneBody, ...]]:
    """Model with every body as a subtree of the universe, and these bodies.

    Args:
        scenario: Resolved scenario, which provides mass properties and damping instead of the URDF.
        descriptions: URDF of each body, by the body's dotted path.
    """
    configs: dict[str, Robot | Target] = {f"robots.{name}": robot for name, robot in scenario.robots.items()}
    if scenario.target is not None:
        configs["target"] = scenario.target
    model = pin.Model()
    model.name = scenario.name
    for path, config in configs.items():
        # new model with one more body: Pinocchio's parser must not extend a model that is still in use
        name = path.rpartition(".")[2]
        description = descriptions[path]
        xml, base = description.to_pinocchio_xml(prefix=f"{name}/"), config.base
        placement = pin.SE3.Identity()
        if base.joint == "fixed":
            part = pin.buildModelFromXML(xml)
            placement.rotation = pin.rpy.rpyToMatrix(np.radians(base.rotation_deg))
            placement.translation = np.array(base.position, dtype=float)
        elif base.joint == "planar":
            part = pin.buildModelFromXML(xml, pin.JointModelPlanar(), _root_name(name, description))
            placement.translation = np.array([0.0, 0.0, base.position[2]])
        else:
            part = pin.buildModelFromXML(xml, pin.JointModelFreeFlyer(), _root_name(name, description))
        # rename the frames of joints that are called like a link: a URDF may do so, ``appendModel`` fails
        links = {frame.name for frame in part.frames if frame.type == pin.FrameType.BODY}
        for frame in part.frames:
            if frame.type != pin.FrameType.BODY:
                while frame.name in links:
                    frame.name += "_joint"
        model = pin.appendModel(model, part, 0, placement)
    model.gravity.linear = np.array(scenario.gravity)
    bodies = tuple(_body(model, path, config, descriptions[path]) for path, config in configs.items())
    for body in bodies:
        # inertias from the scenario: links welded together by fixed joints add up at their moving joint
        totals = {joint: pin.Inertia.Zero() for joint in body.subtree}
        for name, link in body.config.links.items():
            frame = model.frames[model.getFrameId(f"{body.name}/{name}", pin.FrameType.BODY)]
            if frame.parentJoint in totals:  # not welded to the world
                totals[frame.parentJoint] += frame.placement.act(link_inertia(link))
        for name, lender, rest in lent(model, body):
            if lender.parentJoint in totals:
                totals[lender.parentJoint] -= (lender.placement * rest).act(
                    link_inertia(body.config.links[name])
                )
        for place, inertia in totals.items():
            model.inertias[place] = inertia
        damping, springs = np.array(model.damping), body.spring_constants
        for name, joint in body.config.joints.items():
            resistance = (joint.damping or 0.0) + springs.get(name, (0.0, 0.0))[1]
            damping[model.joints[model.getJointId(f"{body.name}/{name}")].idx_v] = resistance
        model.damping = damping
    return model, bodies


def _root_name(name: str, description: Description) -> str:
    """Name of a floating base's joint, distinct from those of the body's own joints."""
    names, root = {joint.name for joint in description.joints}, ROOT
    while root in names:
        root += "_"
    return f"{name}/{root}"


def _body(model: Any, path: str, config: Robot | Target, description: Description) -> SceneBody:
    name = path.rpartition(".")[2]
    moving = {joint.name: config.joints[joint.name] for joint in description.joints if joint.kind != "fixed"}
    config = config.model_copy(update={"joints": moving})
    floating = config.base.joint != "fixed"
    root_joint = int(model.getJointId(_root_name(name, description))) if floating else 0
    joints = tuple(
        j for j in range(1, model.njoints) if model.names[j].startswith(f"{name}/") and j != root_joint
    )
    ids = {str(model.names[j]).removeprefix(f"{name}/"): j for j in joints}
    root_frame = int(model.getFrameId(f"{name}/{description.root}", pin.FrameType.BODY))
    ties = tuple(
        MimicJoint(ids[joint.name], ids[joint.mimic.joint], joint.mimic.multiplier, joint.mimic.offset)
        for joint in description.joints
        if joint.mimic is not None and joint.kind != "fixed"
    )
    tied = {tie.joint for tie in ties}
    bends = {
        joint
        for key, flexible in config.flexible.items()
        for joint in flexible.springs(description, key, lambda _: 0.0)
    }
    free = [name for name, joint in ids.items() if joint not in tied and name not in bends]
    actuators = config.driven_by() if isinstance(config, Robot) else ()
    owned = tuple(ids[joint] for _, actuator in actuators for joint in actuator.owns(free))
    passive = tuple(joint for name, joint in ids.items() if name in bends)
    return SceneBody(name, path, config, description, root_frame, root_joint, joints, ties, owned, passive)


def lent(model: Any, body: SceneBody) -> Iterator[tuple[str, Any, Any]]:
    """Links whose mass another link includes: name, frame of the including link, and rest pose in it.

    Args:
        model: Pinocchio model of the scene.
        body: Body of the links.
    """
    for link in body.description.links:
        if link.borrowed is not None and link.name in body.config.links:
            lender, rest = link.borrowed
            frame = model.frames[model.getFrameId(f"{body.name}/{lender}", pin.FrameType.BODY)]
            yield link.name, frame, pin.SE3(np.array(rest))


def link_inertia(link: Any) -> Any:
    """``pinocchio.Inertia`` of a resolved link, in link axes."""
    ixx, iyy, izz, ixy, ixz, iyz = link.inertia or (0.0,) * 6
    inertia = pin.Inertia(link.mass or 0.0, np.array(link.com or (0.0, 0.0, 0.0)), np.zeros((3, 3)))
    # not by the constructor, which judges links that are welded together one by one
    inertia.inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return inertia
