"""Signals of a robot and of the target that controllers may read, by name."""

from __future__ import annotations

import casadi as ca

from spacerobot.elements.core.context import RobotContext, TipContext
from spacerobot.elements.sensors.joint_position import joint_position
from spacerobot.symbolic import Plant

Reading = tuple[ca.SX, ca.SX | None, ca.SX | None]
"""Arguments of :meth:`TipContext.read` after the name of the signal."""


def robot_values(robot: RobotContext) -> dict[str, ca.SX]:
    """True values (n x 1) of the signals of the joints and of a floating base, world axes.

    Args:
        robot: The robot as controllers see it. The base's orientation is the rotation vector since the start.
    """
    plant = robot.plant
    positions = [joint_position(plant.model, joint, plant.q) for joint in robot.joints]
    values = {"joint_position": ca.vertcat(*positions), "joint_rate": plant.v[list(robot.columns)]}
    if robot.base_joint:
        first = robot.context.once("attitude", robot.start.placement(robot.base_frame)[0])
        rotation, origin = plant.placement(robot.base_frame)
        velocity, spin = plant.velocity(robot.base_frame)
        values |= {
            "base_position": origin,
            "base_orientation": plant.orientation_error(rotation, first),
            "base_velocity": velocity,
            "base_spin": spin,
        }
    return values


def target_readings(robot: RobotContext, tip: TipContext, link: str) -> dict[str, Reading]:
    """Signals of a link of the target as a tip sees it; positions and orientations known in world axes.

    Args:
        robot, tip: The robot and its tip as controllers see them.
        link: Name of the link, usually a mating frame. Its orientation is the rotation vector since the
            start.
    """
    plant = robot.plant
    frame = _target_frame(plant, link)
    rotation, origin = plant.placement(frame)
    velocity, spin = plant.velocity(frame)
    first = first_rotation(robot, tip, link)
    return {
        "target_position": (origin - tip.position, origin, None),
        "target_orientation": (
            plant.orientation_error(rotation, tip.rotation),
            plant.orientation_error(rotation, first),
            None,
        ),
        "target_velocity": (velocity, None, origin),
        "target_spin": (spin, None, None),
    }


def first_rotation(robot: RobotContext, tip: TipContext, link: str) -> ca.SX:
    """Rotation of a link of the target at the start (3x3), from which its orientation is counted.

    Args:
        robot, tip, link: As for :func:`target_readings`.
    """
    frame = _target_frame(robot.plant, link)
    return robot.context.once(f"attitude.{tip.label}", robot.start.placement(frame)[0])


def _target_frame(plant: Plant, link: str) -> int:
    import pinocchio as pin  # not needed to validate a section

    return int(plant.model.getFrameId(f"target/{link}", pin.FrameType.BODY))
