"""Integral of squared angular momenta of reaction wheels."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class WheelMomentumCost(PlanCost):
    """Integral of squared angular momenta of reaction wheels, where they alone turn a base."""

    unit: ClassVar[str] = "N m s"

    kind: Literal["wheel_momentum"] = "wheel_momentum"
    weight: float = weight(
        "1/(N^2 m^2 s^3)",
        "the integral of squared angular momenta of reaction wheels about their axes, where they alone turn "
        "a base",
    )

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        return sum((ca.sumsqr(wheels.momenta) for wheels in instant.wheels().values()), ca.SX(0))
