"""A joint that fails at a time: its brake locks it, or its motor loses torque.

A lock is the acceleration constraint ``v_j' + k v_j = 0`` of one entry of v. It begins with the plastic
impulse that stops the joint, ``M (v+ - v-) = e_j p`` with ``e_j^T v+ = 0``: internal, so momentum is kept and
energy is lost.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.elements.actuator import Actuator
from spacerobot.elements.context import ActuatorContext, unit_load
from spacerobot.elements.contribution import AccelerationConstraint, ActuatorDrive, Contribution, Output
from spacerobot.elements.event import Event, negated
from spacerobot.elements.registry import register
from spacerobot.elements.robot_element import RobotProperties
from spacerobot.errors import near_names
from spacerobot.section import quantity

DECAY = 20.0
"""Rate [1/s] at which the rounding error of a locked joint's speed decays."""


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
        event = Event(
            f"{name}.failed",
            "failed",
            name,
            context.time - context.number("at"),
            negated(failed),
            {failed.name(): True},
            impact=self.mode == "locked",
            clock=True,
        )
        if self.mode == "locked":
            return Contribution(constraints=(_lock(actuator, column, name, failed),), events=(event,))
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


def _lock(actuator: ActuatorContext, column: int, name: str, failed: ca.SX) -> AccelerationConstraint:
    """Constraint that holds a failed joint at rest; its one direction stands for the joint's axis."""
    plant = actuator.plant
    unit, rate = ca.SX(plant.v.size1(), 1), plant.v[column]
    unit[column] = 1

    def answer(force: ca.SX, torque: ca.SX) -> Contribution:
        del force
        text = "torque of the brakes of locked joints"
        return Contribution(outputs=(Output("brake_torque", -torque[2], "N m or N", text, "brake", name),))

    directions, sense = (unit_load(2, rotation=True),), plant.reduced(unit)
    return AccelerationConstraint(directions, sense, DECAY * rate, rate, answer, active=failed)
