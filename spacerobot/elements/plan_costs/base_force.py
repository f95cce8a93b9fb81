"""Integral of squared forces on bases."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import AxesCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class BaseForceCost(AxesCost):
    """Integral of squared forces on bases."""

    unit: ClassVar[str] = "N"
    weighs: ClassVar[str] = "forces on bases: give `limits.base_force`, or actuators of the base"

    kind: Literal["base_force"] = "base_force"
    weight: float = weight("1/(N^2 s)", "the integral of squared forces on the bases, root link's axes")

    def vectors(self, instant: PlanInstant) -> Iterator[ca.SX]:
        """Of each floating base."""
        for base in instant.bases().values():
            yield base.force
