"""Integral of the energy of vibrations."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class VibrationCost(PlanCost):
    """Integral of the energy of flexible links: elastic, and kinetic of their motion in their joints.

    Of modes that is ``sum (h'^2 + w^2 h^2) / 2``, h being their mass-normalised coordinates.
    """

    unit: ClassVar[str] = "J s"
    reported: ClassVar[Literal["rms", "integral", "root"]] = "integral"
    weighs: ClassVar[str] = "flexible links"

    kind: Literal["vibration"] = "vibration"
    weight: float = weight("1/(J s)", "the integral of the energy of flexible links")

    def expression(self, instant: PlanInstant) -> ca.SX:
        """That energy."""
        return instant.vibration_energy()
