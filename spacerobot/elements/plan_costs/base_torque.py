"""Integral of squared torques on bases."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import AxesCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class BaseTorqueCost(AxesCost):
    """Integral of squared torques on bases."""

    unit: ClassVar[str] = "N m"
    weighs: ClassVar[str] = "torques on bases: give `limits.base_torque`, or actuators of the base"

    kind: Literal["base_torque"] = "base_torque"
    weight: float = weight("1/(N^2 m^2 s)", "the integral of squared torques on the bases, root link's axes")

    def vectors(self, instant: PlanInstant) -> Iterator[ca.SX]:
        """Of each floating base."""
        for base in instant.bases().values():
            yield base.torque
