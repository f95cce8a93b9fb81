"""Integral of squared joint accelerations: keeps arms of many links from whipping."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import JointCost, weight
from spacerobot.elements.plan_instant import JointCoordinate
from spacerobot.elements.registry import register


@register
class JointAccelerationCost(JointCost):
    """Integral of squared joint accelerations: keeps arms of many links from whipping."""

    unit: ClassVar[str] = "rad/s^2"

    kind: Literal["joint_acceleration"] = "joint_acceleration"
    weight: float = weight("s^3/rad^2", "the integral of squared joint accelerations")

    def value(self, joint: JointCoordinate) -> ca.SX:
        """Acceleration."""
        return joint.acceleration
