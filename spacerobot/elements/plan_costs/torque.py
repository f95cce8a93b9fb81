"""Integral of squared joint torques and forces."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import JointCost, weight
from spacerobot.elements.plan_instant import JointCoordinate
from spacerobot.elements.registry import register


@register
class TorqueCost(JointCost):
    """Integral of squared joint torques and forces."""

    unit: ClassVar[str] = "N m"

    kind: Literal["torque"] = "torque"
    weight: float = weight("1/(N^2 m^2 s)", "the integral of squared joint torques and forces")

    def value(self, joint: JointCoordinate) -> ca.SX:
        """Torque."""
        return joint.torque
