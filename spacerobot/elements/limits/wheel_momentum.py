"""Maximum angular momentum of any reaction wheel about its axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import casadi as ca

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class WheelMomentumLimit(PlanLimit):
    """Maximum angular momentum of any reaction wheel about its axis."""

    kind: Literal["wheel_momentum"] = "wheel_momentum"
    upper: float = quantity(
        "N m s",
        "maximum angular momentum of any reaction wheel about its axis, where wheels alone turn a base",
        gt=0,
    )

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the momentum of each wheel."""
        for robot, wheels in instant.wheels().items():
            for k, value in enumerate(ca.vertsplit(wheels.momenta)):
                label = f"momentum of {robot}'s wheel {k}"
                yield BoundedRow(label, "N m s", value, -self.upper, self.upper, size=self.upper)
