"""Integral of squared joint rates and speeds."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import JointCost, weight
from spacerobot.elements.plan_instant import JointCoordinate
from spacerobot.elements.registry import register


@register
class JointRateCost(JointCost):
    """Integral of squared joint rates and speeds."""

    unit: ClassVar[str] = "rad/s"

    kind: Literal["joint_rate"] = "joint_rate"
    weight: float = weight("s/rad^2", "the integral of squared joint rates and speeds")

    def value(self, joint: JointCoordinate) -> ca.SX:
        """Rate."""
        return joint.rate
