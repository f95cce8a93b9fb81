"""Ideal actuator of a base: a bounded external wrench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.section import quantity
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.saturation import saturation_events
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import ActuatorDrive, Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part


@register
class BaseWrench(Actuator):
    """Ideal actuator of the base: delivers the commanded external wrench, up to a force and a torque."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    kind: Literal["base_wrench"] = "base_wrench"
    force: float | None = quantity(
        "N", "maximum force along each axis of the root link; not limited if not given", default=None, gt=0
    )
    torque: float | None = quantity(
        "N m",
        "maximum torque about each axis of the root link; not limited if not given",
        default=None,
        gt=0,
    )

    def wrench_limits(self, *, planar: bool) -> Mapping[Part, Array]:
        """Limits of force [N] and torque [N m] along and about every axis."""
        del planar
        part_limits: dict[Part, float | None] = {"force": self.force, "torque": self.torque}
        return {part: np.full(3, np.inf if most is None else most) for part, most in part_limits.items()}

    def build(self, actuator: ActuatorContext) -> Contribution:
        """Contribution: wrench clipped on each axis, and events of saturation."""
        columns, limits = actuator.base_columns, []
        linear = len(columns) - (3 if len(columns) == 6 else 1)
        for key, section_limit, count in (
            ("force", self.force, linear),
            ("torque", self.torque, len(columns) - linear),
        ):
            limit = ca.SX(ca.inf) if section_limit is None else actuator.context.number(key)
            limits.append(ca.repmat(limit, count, 1))
        maximum = ca.vertcat(*limits)
        each: list[float | None] = [self.force] * linear + [self.torque] * (len(columns) - linear)
        bounded = [k for k, limit in enumerate(each) if limit is not None]
        axes = ("fx", "fy", "tz") if len(columns) == 3 else ("fx", "fy", "fz", "tx", "ty", "tz")
        labels = [f"{actuator.robot}/base.{axes[k]}" for k in bounded]

        def kinks(command: ca.SX) -> Contribution:
            """Events where the wrench starts and stops being clipped."""
            excess = ca.fabs(command[bounded]) / maximum[bounded] - 1
            return Contribution(events=saturation_events(actuator, labels, excess))

        return Contribution(
            drives=(
                ActuatorDrive(columns, lambda command: ca.fmin(ca.fmax(command, -maximum), maximum), kinks),
            )
        )

    def words(self) -> str:
        """Limits in text form."""
        force, torque = ("any" if most is None else f"{most:g}" for most in (self.force, self.torque))
        return f"base_wrench of at most {force} N, {torque} N m"
