"""Goal of joints at given positions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.section import Name, Section, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant

ROUNDING = 1e-9
"""Tolerance [rad or m] by which a position at the end of a range may lie outside it."""


class End(Section):
    """Position of one joint at the end."""

    angle_deg: float | None = quantity("deg", "of a revolute or continuous joint", default=None)
    offset: float | None = quantity("m", "of a prismatic joint", default=None)

    @model_validator(mode="after")
    def _check(self) -> End:
        if (self.angle_deg is None) == (self.offset is None):
            raise ValueError("give either `angle_deg` or `offset`")
        return self


@register
class Posture(Goal):
    """Joints of a robot reach given positions."""

    told_by: ClassVar[str | None] = "joints"

    kind: Literal["posture"] = "posture"
    robot: Name = Field(description="robot whose joints reach `joints`")
    joints: dict[str, End] = Field(
        min_length=1, description="joint positions at the end, by name; `*` matches any letters"
    )

    within_deg: float = quantity(
        "deg", "tolerance of the angles of revolute and continuous joints", default=0.0, ge=0
    )
    within: float = quantity("m", "tolerance of the offsets of prismatic joints", default=0.0, ge=0)

    @property
    def body(self) -> str:
        """The robot."""
        return self.robot

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Terminal constraints on each joint's remaining distance; an angle if the joint is unbounded."""
        for joint, end in instant.joints(self.robot, self.joints, "joints"):
            turns = end.offset is None
            target_position = float(np.radians(end.angle_deg or 0.0)) + (end.offset or 0.0)
            if not joint.lower - ROUNDING <= target_position <= joint.upper + ROUNDING:
                numbers = (
                    (float(np.degrees(x)) if turns else x)
                    for x in (target_position, joint.lower, joint.upper)
                )
                text = "found {:.6g}, allowed: the joint's range of {:.6g} to {:.6g}".format(*numbers)
                raise instant.fault(f"{text} {'deg' if turns else 'm'}", f"joints.{joint.name}")
            tolerance = float(np.radians(self.within_deg)) if turns else self.within
            name = "position" if joint.position.numel() == 1 else "angle"
            yield BoundedRow(
                f"{name} of {joint.name}", "rad or m", joint.off(target_position), -tolerance, tolerance
            )
