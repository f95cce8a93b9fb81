"""Integral of squared forces of grasps that hold."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class GripForceCost(PlanCost):
    """Integral of squared forces of grasps that hold."""

    unit: ClassVar[str] = "N"
    weighs: ClassVar[str] = "grasps that hold"

    kind: Literal["grip_force"] = "grip_force"
    weight: float = weight("1/(N^2 s)", "the integral of squared forces of grasps that hold")

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        return sum((ca.sumsqr(force) for force, _ in instant.grips().values()), ca.SX(0))
