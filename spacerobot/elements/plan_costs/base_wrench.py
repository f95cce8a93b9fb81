"""Integral of squared forces and torques on bases."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class BaseWrenchCost(PlanCost):
    """Integral of squared forces and torques on bases, N and N m alike."""

    unit: ClassVar[str] = "N"
    weighs: ClassVar[str] = "wrenches on bases: give `limits.base_force`, or actuators of the base"

    kind: Literal["base_wrench"] = "base_wrench"
    weight: float = weight("1/(N^2 s)", "the integral of squared forces [N] and torques [N m] on the bases")

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        bases = instant.bases().values()
        return sum((ca.sumsqr(base.force) + ca.sumsqr(base.torque) for base in bases), ca.SX(0))
