"""Goal of flexible links at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from spacerobot.common.section import Name
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, zero


@register
class Undeformed(Goal):
    """Flexible links of a robot or the target are undeformed and at rest, without vibration afterwards."""

    told_by: ClassVar[str | None] = "undeformed"

    kind: Literal["undeformed"] = "undeformed"
    undeformed: Name = Field(description="robot, or target, whose flexible links are at rest at the end")

    @property
    def body(self) -> str:
        """The one that has them."""
        return self.undeformed

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Positions and rates of their joints."""
        for name, (position, rate) in instant.flexible(self.undeformed, "undeformed").items():
            yield zero(f"deflection of {name}", "rad or m", position)
            yield zero(f"deflection rate of {name}", "rad/s or m/s", rate)
