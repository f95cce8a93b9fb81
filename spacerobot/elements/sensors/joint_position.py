"""Positions of joints with one degree of freedom."""

from __future__ import annotations

from typing import Any

import casadi as ca

from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.sensors.sensor import measured


def joint_position(model: Any, joint: int, q: ca.SX) -> ca.SX:
    """Position of a one-degree-of-freedom joint [rad or m]; an unbounded one is read from its cos and sin."""
    pin_joint = model.joints[joint]
    if pin_joint.nq == 2:
        return ca.atan2(q[pin_joint.idx_q + 1], q[pin_joint.idx_q])
    return q[pin_joint.idx_q]


def read_positions(robot: RobotContext, desired: ca.SX) -> list[ca.SX]:
    """Measured positions of a robot's joints, each moved by whole turns to be nearest to the desired one."""
    model, q, joints = robot.plant.model, robot.plant.q, robot.joints
    last = robot.held("joint_position", ca.vertcat(*(joint_position(model, joint, q) for joint in joints)))
    positions = []
    for i, joint in enumerate(joints):
        if last is None:
            positions.append(
                measured(robot.sensors("joint_position"), nearest_position(model, joint, q, desired[i]))
            )
        elif model.joints[joint].nq == 2:
            difference = last[i] - desired[i]
            positions.append(desired[i] + ca.atan2(ca.sin(difference), ca.cos(difference)))
        else:
            positions.append(last[i])
    return positions


def nearest_position(model: Any, joint: int, q: ca.SX, desired: ca.SX) -> ca.SX:
    """Position of a joint; for an unbounded joint the equivalent angle nearest to the desired position.

    The desired position may pass half a turn, where the angle from cos and sin jumps by a whole turn.
    """
    pin_joint = model.joints[joint]
    if pin_joint.nq == 1:
        return joint_position(model, joint, q)
    cos, sin = q[pin_joint.idx_q], q[pin_joint.idx_q + 1]
    difference = ca.atan2(
        sin * ca.cos(desired) - cos * ca.sin(desired), cos * ca.cos(desired) + sin * ca.sin(desired)
    )
    return desired + difference
