"""Maximum displacement of any robot's base since the start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class BaseTranslationLimit(PlanLimit):
    """Maximum displacement of any robot's base since the start."""

    relative_to_start: ClassVar[bool] = True

    kind: Literal["base_translation"] = "base_translation"
    upper: float = quantity("m", "maximum displacement of any robot's base since the start", gt=0)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the displacement of each base."""
        for name, base in instant.bases().items():
            yield within(f"displacement of {name}'s base", "m", base.translation, self.upper)
