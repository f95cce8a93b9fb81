"""Maximum speed of any robot's floating base."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class BaseSpeedLimit(PlanLimit):
    """Maximum speed of any robot's floating base."""

    kind: Literal["base_speed"] = "base_speed"
    upper: float = quantity("m/s", "maximum speed of the root link's origin in the world's axes", gt=0)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the velocity of each base."""
        for name, base in instant.bases().items():
            yield within(f"speed of {name}'s base", "m/s", base.frame.velocity, self.upper)
