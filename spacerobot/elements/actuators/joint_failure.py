"""Failure of joints at a time: brakes lock them, or motors lose torque or run away."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import matching, quantity
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.joint_lock import held_joints
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import ActuatorDrive, Contribution
from spacerobot.elements.core.failure import failing
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties

HELD = ("locked", "runaway")
"""Modes in which a joint is held at a constant rate."""


@register
class JointFailure(Actuator):
    """Failure of a joint, or of a whole arm, at a time: it locks, swings free, runs on, or loses torque."""

    fails_joints: ClassVar[bool] = True

    kind: Literal["joint_failure"] = "joint_failure"
    joint: str = Field(
        min_length=1, description="joint by name; `*` matches any letters, as `left_*` for an arm"
    )
    mode: Literal["locked", "free", "weak", "runaway"] = Field(
        default="locked",
        description="locked: the brake stops the joint at once and holds it; free: the motor gives no "
        "torque; weak: the motor gives the part `remaining` of its torque; runaway: the motor holds the rate "
        "that the joint has",
    )
    at: float = quantity("s", "time of the failure", ge=0)
    remaining: float = quantity(
        "1", "part of the torque that is left, where `mode` is `weak`", default=0.5, ge=0, le=1
    )

    known: bool = Field(
        default=False,
        description="whether resolved rates and torques in the null space do without the joint from then on, "
        "where it is held",
    )

    @model_validator(mode="after")
    def _check(self) -> JointFailure:
        if self.known and self.mode not in HELD:
            raise ValueError(f"known: found true, allowed: where `mode` is {' or '.join(HELD)}")
        return self

    def locks(self, joints: Sequence[str]) -> list[str]:
        """Joints that controllers know to be held."""
        return matching(joints, self.joint) if self.known else []

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: failure event, and constraints on the joints or reduced torques from then on."""
        context, joints = actuator.context, matching(actuator.columns, self.joint)
        name = f"{actuator.robot}/{self.joint}"
        if self.mode in HELD:
            running = self.mode == "runaway"
            holding, sets, updates = held_joints(actuator, joints, running=running, is_known=self.known)
            impact = self.mode == "locked"
            _, event = failing(context, name, sets=sets, updates=updates, impact=impact)
            return replace(holding, events=(event,))
        failed, event = failing(context, name)
        remaining = context.number("remaining") if self.mode == "weak" else ca.SX(1, 1)
        factor = 1 - failed * (1 - remaining)
        columns = tuple(actuator.columns[joint] for joint in joints)
        return Contribution(
            drives=(ActuatorDrive(columns, lambda command: command * factor),), events=(event,)
        )

    @property
    def loses_torque(self) -> bool:
        """Whether the joint's motor fails rather than its brake."""
        return self.mode != "locked"

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A joint that the robot does not have, or that another actuator owns."""
        if not matching(robot.joints, self.joint):
            yield "joint", f"no joint {self.joint!r}; {near_names(self.joint, robot.joints)}"

    def words(self) -> str:
        """Failure and its time, in text form."""
        effect = {
            "locked": "locks",
            "free": "swings free",
            "weak": f"keeps {self.remaining:g} of its torque",
            "runaway": "runs on at the rate it has",
        }[self.mode]
        return f"{self.joint} {effect} at {self.at:g} s"
