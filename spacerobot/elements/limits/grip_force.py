"""Maximum force of any grasp that holds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class GripForceLimit(PlanLimit):
    """Maximum force of any grasp that holds."""

    kind: Literal["grip_force"] = "grip_force"
    upper: float = quantity("N", "maximum force of any grasp that holds", gt=0)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the force of each grasp."""
        for name, wrench in instant.grips().items():
            value = wrench[0]
            if value.numel():
                row = within(f"grip force of {name}", "N", value, self.upper)
                yield dataclasses.replace(row, size=self.upper)
