"""Simple controllers that all programs have: constant torques, and position control of joints."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.common.section import Vector, quantity
from spacerobot.elements import Contribution, RobotContext, register
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.contribution import ControlChannel
from spacerobot.elements.core.robot_element import Part
from spacerobot.elements.sensors.joint_position import joint_position


@register
class ConstantTorques(RobotController):
    """Constant joint torques."""

    kind: Literal["constant_torques"] = "constant_torques"
    torques: tuple[float, ...] = quantity("N m", "of each free joint, in the order of the model")

    def build(self, robot: RobotContext) -> Contribution:
        """The torques."""
        return Contribution(torques=(robot.torque(ca.DM(self.torques)),))


@register
class ConstantBaseTorque(RobotController):
    """A torque that is constant in the axes of the base, which wheels deliver."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"torque"})
    kind: Literal["constant_base_torque"] = "constant_base_torque"
    torque: Vector = quantity("N m", "root link's axes")

    def build(self, robot: RobotContext) -> Contribution:
        """The torque, as a command to the base's actuators."""
        plant = robot.plant
        turning = plant.jacobian(robot.base_frame)[3:, :].T
        command = ca.mtimes(plant.placement(robot.base_frame)[0], robot.context.vector("torque"))
        sense = ca.SX(plant.v.size1(), 3)
        drive = plant.reduced(turning)
        channel = ControlChannel(robot.name, turning, drive, sense, command, None, moves_tip=False)
        return Contribution(channels=(channel,))


@register
class SinePosition(RobotController):
    """Position control of joints with sinusoidal commands."""

    kind: Literal["sine_position"] = "sine_position"
    kp: tuple[float, ...] = quantity("N m/rad", "of each free joint, in the order of the model")
    kv: tuple[float, ...] = quantity("N m s/rad", "of each free joint")
    amplitude: tuple[float, ...] = quantity("rad", "of each joint's command")
    frequency: tuple[float, ...] = quantity("Hz", "of each joint's command")

    def build(self, robot: RobotContext) -> Contribution:
        """Torques kp (command - position) - kv rate."""
        plant = robot.plant
        positions = ca.vertcat(*(joint_position(plant.model, joint, plant.q) for joint in robot.joints))
        angles = 2 * ca.pi * ca.DM(self.frequency) * robot.context.time
        errors = ca.DM(self.amplitude) * ca.sin(angles) - positions
        rates = plant.v[list(robot.columns)]
        return Contribution(torques=(robot.torque(ca.DM(self.kp) * errors - ca.DM(self.kv) * rates),))
