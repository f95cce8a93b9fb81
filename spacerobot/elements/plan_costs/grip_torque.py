"""Integral of squared torques of grasps that hold."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class GripTorqueCost(PlanCost):
    """Integral of squared torques of grasps that hold."""

    unit: ClassVar[str] = "N m"
    weighs: ClassVar[str] = "grasps that hold orientation too"

    kind: Literal["grip_torque"] = "grip_torque"
    weight: float = weight("1/(N^2 m^2 s)", "the integral of squared torques of grasps that hold")

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        return sum((ca.sumsqr(torque) for _, torque in instant.grips().values()), ca.SX(0))
