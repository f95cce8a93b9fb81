"""A joint that fails at a time: its brake locks it, or its motor loses torque.

Locks are those of :mod:`spacerobot.elements.joint_lock`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.elements.actuator import Actuator
from spacerobot.elements.context import ActuatorContext
from spacerobot.elements.contribution import ActuatorDrive, Contribution
from spacerobot.elements.event import Event, negated
from spacerobot.elements.joint_lock import lock
from spacerobot.elements.registry import register
from spacerobot.elements.robot_element import RobotProperties
from spacerobot.errors import near_names
from spacerobot.section import quantity


@register
class JointFailure(Actuator):
    """Failure of one joint at a time: it locks, swings free, or keeps a part of its torque."""

    kind: Literal["joint_failure"] = "joint_failure"
    joint: str = Field(min_length=1, description="joint by name")
    mode: Literal["locked", "free", "weak"] = Field(
        default="locked",
        description="locked: the brake stops the joint at once and holds it; free: the motor gives no "
        "torque; weak: the motor gives the part `remaining` of its torque",
    )
    at: float = quantity("s", "time of the failure", ge=0)
    remaining: float = quantity(
        "1", "part of the torque that is left, where `mode` is `weak`", default=0.5, ge=0, le=1
    )

    def build(self, actuator: ActuatorContext) -> Contribution:
        """The event, and the lock or the reduced torque behind it."""
        context, column = actuator.context, actuator.columns[self.joint]
        name = f"{actuator.robot}/{self.joint}"
        failed = context.switch("failed")
        held = lock(actuator, self.joint) if self.mode == "locked" else None
        event = Event(
            f"{name}.failed",
            "failed",
            name,
            context.time - context.number("at"),
            negated(failed),
            {failed.name(): True} | ({held[0].name(): True} if held else {}),
            impact=self.mode == "locked",
            clock=True,
        )
        if held:
            return Contribution(constraints=held[1], events=(event,))
        left = context.number("remaining") if self.mode == "weak" else ca.SX(1, 1)
        factor = 1 - failed * (1 - left)
        return Contribution(drives=(ActuatorDrive((column,), lambda asked: asked * factor),), events=(event,))

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A joint that the robot does not have, or that another actuator owns."""
        if self.joint not in robot.joints:
            yield "joint", f"no joint {self.joint!r}; {near_names(self.joint, robot.joints)}"

    def words(self) -> str:
        """The failure and its time."""
        what = {
            "locked": "locks",
            "free": "swings free",
            "weak": f"keeps {self.remaining:g} of its torque",
        }[self.mode]
        return f"{self.joint} {what} at {self.at:g} s"
