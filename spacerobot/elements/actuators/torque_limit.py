"""Saturation of joint torques at a maximum."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.errors import near_names
from spacerobot.common.section import matching, quantity
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.saturation import saturation_events
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import ActuatorDrive, Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties


@register
class TorqueLimit(Actuator):
    """Joint motors that deliver the commanded torque, or force, up to a maximum."""

    kind: Literal["torque_limit"] = "torque_limit"
    joints: str = Field(default="*", description="joint by name; `*` matches any letters")
    limit: float | None = quantity(
        "N m or N",
        "maximum torque or force of each; the joint's `torque_limit`, or the URDF's effort, if not given",
        default=None,
        gt=0,
    )

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: torque of each joint clipped at its limit."""
        names = self.limits(tuple(actuator.columns))
        if not names:
            return Contribution()
        if self.limit is None:
            limit = ca.vertcat(*(actuator.joint_number(name, "torque_limit") for name in names))
        else:
            limit = ca.repmat(actuator.context.number("limit"), len(names), 1)
        columns = tuple(actuator.columns[name] for name in names)
        labels = [f"{actuator.robot}/{name}" for name in names]

        def kinks(command: ca.SX) -> Contribution:
            """Events where torques start and stop being clipped."""
            return Contribution(events=saturation_events(actuator, labels, ca.fabs(command) / limit - 1))

        return Contribution(
            drives=(ActuatorDrive(columns, lambda command: ca.fmin(ca.fmax(command, -limit), limit), kinks),)
        )

    def limits(self, joints: Sequence[str]) -> list[str]:
        """Joints that match the pattern."""
        return matching(joints, self.joints)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: a pattern that matches no joint, and joints without a limit."""
        names = self.limits(robot.joints)
        if not names and self.joints != "*":
            yield "joints", f"no joint {self.joints!r}; {near_names(self.joints, robot.joints)}"
        without = [name for name in names if self.limit is None and robot.limits[name] is None]
        if without:
            zero = " (effort 0 in the URDF)"
            joint_list = ", ".join(name + zero * (robot.efforts[name] == 0) for name in without)
            yield "", f"no effort limit in the URDF, nor joints.*.torque_limit, for {joint_list}"

    def words(self) -> str:
        """Joints and limit, in text form."""
        maximum = "their efforts" if self.limit is None else f"{self.limit:g} N m or N"
        return f"torque_limit of {self.joints} at {maximum}"
