"""Actuators: delivery of the generalized forces that controllers command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.robot_element import Part, RobotElement
from spacerobot.registry import required

FIRING = "firing"
"""First word of the switches of pulses; they end between the instants of software."""


@dataclass(frozen=True)
class MomentumStorage:
    """A set of n equal wheels on a base, whose inertia is not the root link's.

    Attributes:
        axes: Unit vectors along the wheels' axes (3, n), root link's axes.
        inertia: Moment of inertia of each wheel about its axis [kg m^2].
        speeds: Initial speeds relative to the base (n,) [rad/s].
        torque_limit, speed_limit: Limits of each wheel [N m, rad/s]; None where not limited.
    """

    axes: Array
    inertia: float
    speeds: Array
    torque_limit: float | None
    speed_limit: float | None


class Actuator(RobotElement):
    """An actuator of a robot, of its joints or of its base.

    By a :class:`~spacerobot.elements.ActuatorDrive` it acts on components of the velocity: it
    receives the forces commanded there and returns those delivered. Others are delivered as commanded.
    A wheel brings a state, a wrench on the base and the momentum it stores; a thruster a wrench from outside.
    Several actuators of one joint act one after the other, in the scenario's order.

    Attributes:
        has_wheels: Whether it has wheels, whose momentum another actuator may unload.
        has_motors: Whether it has motors that move relative to their joints, so that encoders there read
            something else.
        detects_failures: Whether it compares the torques commanded with the motion, so that failures must
            follow it.
        fails_joints: Whether it is a failure of joints.
    """

    family: ClassVar[str] = "actuator"
    has_wheels: ClassVar[bool] = False
    has_motors: ClassVar[bool] = False
    detects_failures: ClassVar[bool] = False
    fails_joints: ClassVar[bool] = False

    @property
    def unloads(self) -> bool:
        """Whether it drives the momentum of the robot's wheels to a goal."""
        return False

    @property
    def sees_wheels(self) -> bool:
        """Whether it uses the momentum of the robot's wheels."""
        return self.unloads

    @property
    def loses_torque(self) -> bool:
        """Whether a failure keeps it from delivering torques that are commanded."""
        return False

    def wrench_limits(self, *, planar: bool) -> Mapping[Part, Array]:
        """Force and torque on the base that it delivers, however they come together.

        Args:
            planar: Whether the base moves in the x-y plane alone.

        Returns:
            mapping: Greatest force along [N] and torque about [N m] each axis of the root link (3,), infinite
                where there is no limit; without the parts that plans may not use. Empty for one that plans do
                not use.
        """
        del planar
        return {}

    def joined_limits(self, limits: Array, after: Array) -> Array:
        """Limits of a force or torque together with those of the actuators that act on the base after it.

        As a rule the next actuator takes over what this one delivers, so that the lower limit holds.

        Args:
            limits: Largest force [N] or torque [N m] of this actuator along or about each axis of the root
                link (3,).
            after: The same of the actuators after it.
        """
        return np.minimum(limits, after)

    def momentum_storage(self) -> MomentumStorage | None:
        """Wheels that exchange angular momentum with the base, for a plan to follow their momentum."""
        return None

    @required()
    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution to the closed loop."""
        raise NotImplementedError

    def limits(self, joints: Sequence[str]) -> list[str]:
        """Joints of a robot whose torque it bounds."""
        del joints
        return []

    def locks(self, joints: Sequence[str]) -> list[str]:
        """Joints of a robot that it may hold, with the controllers' knowledge."""
        del joints
        return []

    def owns(self, joints: Sequence[str]) -> list[str]:
        """Joints of a robot that it owns, such as a wheel's: the arm's controllers do not see them."""
        del joints
        return []
