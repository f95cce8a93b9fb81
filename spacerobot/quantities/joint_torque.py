"""Torques and forces of joint actuators."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.joint_motion import NO_JOINT, joint_unit
from spacerobot.quantities.quantity import Columns, PlanBound, Quantity, SignalSource

torque_unit = joint_unit("N m", "N")


def by_robot(source: SignalSource) -> Columns:
    """Absolute values of the joint torques [N m] or forces [N] of each robot (n,)."""
    torques_by_robot = dict[str, list[ca.SX]]()
    for label, torque in source.signal("joint_torque").items():
        torques_by_robot.setdefault(label.partition("/")[0], []).append(torque)
    return {robot: ca.fabs(ca.vertcat(*torques)) for robot, torques in torques_by_robot.items()}


QUANTITIES = (
    Quantity(
        name="joint_torque_peak",
        label="peak joint torque",
        description="largest torque or force of an actuator",
        unit="N m or N",
        reducer="peak",
        expression=by_robot,
        limit="joint_torque",
        absent=NO_JOINT,
        symbol="T",
        scene_unit=torque_unit,
    ),
    Quantity(
        name="joint_torque_rms",
        label="RMS joint torque",
        description="root mean square of the torque or force of a joint",
        unit="N m or N",
        reducer="rms",
        expression="joint_torque",
        total="norm",
        weight="effort",
        cost="torque",
        bounds=(PlanBound("torque", "N m or N", "maximum torque or force of any joint"),),
        is_default=False,
        absent=NO_JOINT,
        scene_unit=torque_unit,
    ),
)
