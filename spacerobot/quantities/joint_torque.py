"""Torques and forces of joint actuators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.quantities.quantity import NOTHING, Components, Context, Quantity

if TYPE_CHECKING:
    from spacerobot.scene import Scene


def per_joint(context: Context) -> Components:
    """Absolute torque [N m] or force [N] of each joint, labelled by its robot."""
    scene = context.scene
    joints = sorted(
        (scene.model.idx_vs[joint], body.name) for body in scene.bodies for joint in body.arm_joints
    )
    torque = context.signals["joint_torque"]
    if torque.numel() != len(joints):
        raise ValueError("every joint has one torque")
    return Components(tuple(owner for _, owner in joints), ca.fabs(torque)) if joints else NOTHING


def torque_unit(scene: Scene) -> str:
    """Unit of what the scene's joint actuators deliver."""
    kinds = {
        scene.model.joints[joint].shortname().startswith("JointModelP")
        for body in scene.bodies
        for joint in body.arm_joints
    }
    return {(False,): "N m", (True,): "N"}.get(tuple(kinds), "N m or N")


QUANTITIES = (
    Quantity(
        "joint_torque_peak",
        "peak joint torque",
        "largest torque or force of an actuator",
        "N m or N",
        "peak",
        per_joint,
        limit="joint_torque",
        absent="no robot of this scene has a joint",
        symbol="T",
        scene_unit=torque_unit,
    ),
)
