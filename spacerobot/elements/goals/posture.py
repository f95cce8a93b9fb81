"""Joints at given positions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from spacerobot.elements.goal import Goal
from spacerobot.elements.instant import Instant, Row, zero
from spacerobot.elements.registry import register
from spacerobot.section import Name, Section, quantity


class End(Section):
    """Where one joint shall be at the end."""

    angle_deg: float | None = quantity("deg", "of a revolute or continuous joint", default=None)
    offset: float | None = quantity("m", "of a prismatic joint", default=None)

    @model_validator(mode="after")
    def _check(self) -> End:
        if (self.angle_deg is None) == (self.offset is None):
            raise ValueError("give either `angle_deg` or `offset`")
        return self


@register
class Posture(Goal):
    """Joints of a robot come to given positions."""

    told_by: ClassVar[str | None] = "joints"

    kind: Literal["posture"] = "posture"
    robot: Name = Field(description="robot whose joints come to `joints`")
    joints: dict[str, End] = Field(
        min_length=1, description="where joints are at the end, by name; `*` stands for any letters"
    )

    @property
    def body(self) -> str:
        """The robot."""
        return self.robot

    def rows(self, instant: Instant) -> Iterator[Row]:
        """What is left of the way, joint by joint; of an unbounded one the angle."""
        for joint, end in instant.joints(self.robot, self.joints, "joints"):
            wanted = float(np.radians(end.angle_deg or 0.0)) + (end.offset or 0.0)
            if joint.position.numel() == 1:
                yield zero(f"position of {joint.name}", "rad or m", joint.off(wanted))
            else:
                yield zero(f"angle of {joint.name}", "rad", joint.off(wanted))
