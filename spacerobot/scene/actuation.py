"""Limits of a robot's actuators: torques of joints, wrench on the base."""

from __future__ import annotations

from spacerobot.common.arrays import Array
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.core.robot_element import Part
from spacerobot.scenario import Robot
from spacerobot.scene.scene import Scene, SceneBody


def torque_limit(body: SceneBody, joint: str) -> float | None:
    """Maximum torque [N m] or force [N] of a joint from scenario or URDF; None if neither states one.

    Args:
        body, joint: The body, and the name of a joint in its URDF.
    """
    limit = body.config.joints[joint].torque_limit
    efforts = {
        joint_description.name: joint_description.effort for joint_description in body.description.joints
    }
    return efforts.get(joint) if limit is None else limit


def wrench_limits(scene: Scene, body: SceneBody) -> dict[Part, Array]:
    """Maximum force [N] and torque [N m] of the actuators of a base along each axis of its root link (3,)."""
    limits: dict[Part, Array] = {}
    actuators = body.config.actuators.values() if isinstance(body.config, Robot) else ()
    for actuator in actuators:
        if isinstance(actuator, Actuator) and body.root_joint:
            for part, limit in actuator.wrench_limits(planar=scene.planar).items():
                limits[part] = limit if part not in limits else actuator.joined_limits(limit, limits[part])
    return limits
