r"""Tracking of a planned motion of a floating base.

$$ w = f\,w_p + K_d\,(v_p - v) $$

with the wrench $w_p$ and velocity $v_p$ of the plan, for each axis of the root link. Position and attitude
are not fed back. After its end the plan is at rest and commands no wrench.
"""

from __future__ import annotations

import casadi as ca

from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import CommandedTorque
from spacerobot.elements.core.robot_element import Part
from spacerobot.elements.references.knot_motion import Knots
from spacerobot.elements.references.plan_following import BaseMotion, table

PLANAR, SPATIAL = ("fx", "fy", "tz"), ("fx", "fy", "fz", "tx", "ty", "tz")
"""Labels of a base's axes, planar and spatial, by the degrees of freedom of its joint."""


def planned_parts(motion: BaseMotion) -> frozenset[Part]:
    """Force, torque or both, by the axes that are planned."""
    return frozenset("torque" if axis.startswith("t") else "force" for axis in motion.axes)


def planned_wrench(
    robot: RobotContext, motion: BaseMotion, knots: Knots, key: str, velocity: ca.SX
) -> CommandedTorque:
    """Wrench on a base that tracks its planned motion.

    Args:
        robot: Robot of the base; its section has ``kd_linear``, ``kd_angular`` and ``feed_forward``.
        motion, knots: Planned motion, and the present instant among its points.
        key: Key of the motion in the section.
        velocity: Velocity and spin of the base as they are known (3 or 6 x 1), root link's axes [m/s, rad/s].

    Returns:
        CommandedTorque: Generalized forces of the base [N, N m].
    """
    number, model, axes = robot.context.number, robot.plant.model, range(len(motion.axes))
    wrench, rate = (
        knots.force(name, table(robot.context, f"{key}.{name}", len(motion.times), axes))
        for name in ("wrench", "rate")
    )
    names = PLANAR if velocity.numel() == 3 else SPATIAL
    first, command = int(model.idx_vs[robot.base_joint]), ca.SX(robot.plant.v.size1(), 1)
    for k, axis in enumerate(motion.axes):
        place = names.index(axis)
        gain = number("kd_angular" if axis.startswith("t") else "kd_linear")
        command[first + place] = number("feed_forward") * wrench[k] + gain * (rate[k] - velocity[place])
    return CommandedTorque(robot.name, command)
