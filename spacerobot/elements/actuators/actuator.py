"""Actuators: delivery of the generalized forces that controllers command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import required
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.robot_element import Part, RobotElement

FIRING = "firing"
"""First word in the names of switches of thruster pulses, which end between the sample instants of
software."""


@dataclass(frozen=True)
class MomentumStorage:
    """A set of n equal wheels on a base, whose inertia is not the root link's.

    Attributes:
        axes: Unit vectors along the wheels' axes (3, n), root link's axes.
        inertia: Moment of inertia of each wheel about its axis [kg m^2].
        speeds: Initial speeds relative to the base (n,) [rad/s].
        torque_limit, speed_limit: Limits of each wheel [N m, rad/s]; None if unlimited.
    """

    axes: Array
    inertia: float
    speeds: Array
    torque_limit: float | None
    speed_limit: float | None


class Actuator(RobotElement):
    """Actuator of a robot's joints or base.

    An :class:`~spacerobot.elements.ActuatorDrive` names the components of the velocity on which the actuator
    acts; it receives the forces commanded there and returns the delivered ones. Components without an
    actuator deliver the commanded force. A wheel adds a state, a wrench on the base and stored momentum; a
    thruster adds an external wrench. Several actuators of one joint act in series, in the scenario's order.

    Attributes:
        has_wheels: Whether it has wheels, whose momentum another actuator may unload.
        has_motors: Whether its motors move relative to their joints, so that encoders on the motors do not
            measure the joints.
        detects_failures: Whether it compares commanded torques with the motion; failures must then come after
            it in the list.
        fails_joints: Whether it models a failure of joints.
    """

    family: ClassVar[str] = "actuator"
    has_wheels: ClassVar[bool] = False
    has_motors: ClassVar[bool] = False
    detects_failures: ClassVar[bool] = False
    fails_joints: ClassVar[bool] = False

    @property
    def unloads(self) -> bool:
        """Whether it drives the momentum of the robot's wheels to a setpoint."""
        return False

    @property
    def sees_wheels(self) -> bool:
        """Whether it uses the momentum of the robot's wheels."""
        return self.unloads

    @property
    def loses_torque(self) -> bool:
        """Whether a failure may keep it from delivering commanded torques."""
        return False

    def wrench_limits(self, *, planar: bool) -> Mapping[Part, Array]:
        """Limits of the force and torque on the base that it can deliver in any combination.

        Args:
            planar: Whether the base moves only in the x-y plane.

        Returns:
            mapping: Maximum force along [N] and torque about [N m] each axis of the root link (3,), infinite
                if unlimited. Parts that plans may not use are missing; empty if plans may not use this
                actuator.
        """
        del planar
        return {}

    def joined_limits(self, limits: Array, after: Array) -> Array:
        """Limits of a force or torque in series with the actuators that act on the base after this one.

        By default the next actuator receives the output of this one, so the lower limit holds.

        Args:
            limits: Maximum force [N] or torque [N m] of this actuator along or about each axis of the root
                link (3,).
            after: Maximum force or torque of the actuators after it (3,).
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
        """Names of the joints whose torque it limits."""
        del joints
        return []

    def locks(self, joints: Sequence[str]) -> list[str]:
        """Names of the joints that it may lock such that controllers are informed."""
        del joints
        return []

    def owns(self, joints: Sequence[str]) -> list[str]:
        """Names of the joints that it owns, such as those of wheels, which arm controllers do not see."""
        del joints
        return []
