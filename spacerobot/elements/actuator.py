"""Actuators: what becomes of the generalized forces that controllers ask for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from spacerobot.elements.context import ActuatorContext
from spacerobot.elements.contribution import Contribution
from spacerobot.elements.robot_element import RobotElement


class Actuator(RobotElement):
    """An actuator of a robot, of its joints or of its base.

    By a :class:`~spacerobot.elements.contribution.ActuatorDrive` it acts on components of the velocity: it
    receives the forces commanded there and returns those delivered. Others are delivered as commanded.
    A wheel brings a state, a wrench on the base and the momentum it stores; a thruster a wrench from outside.
    Several actuators of one joint act one after the other, in the scenario's order.

    Attributes
    ----------
    has_wheels
        Whether it has wheels, whose momentum another actuator may unload.
    """

    family: ClassVar[str] = "actuator"
    has_wheels: ClassVar[bool] = False

    @property
    def unloads(self) -> bool:
        """Whether it drives the momentum of the robot's wheels to a goal."""
        return False

    def build(self, actuator: ActuatorContext) -> Contribution:
        """What it adds to the closed loop."""
        raise NotImplementedError

    def limits(self, joints: Sequence[str]) -> list[str]:
        """Those of a robot's joints whose torque it bounds."""
        del joints
        return []

    def owns(self, joints: Sequence[str]) -> list[str]:
        """Those of a robot's joints that are its own, as a wheel's: the arm's controllers do not see them."""
        del joints
        return []
