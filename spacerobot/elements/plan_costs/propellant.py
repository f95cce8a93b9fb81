"""Impulse that propellant is spent for."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register

SMOOTH = 0.01
"""Part of a force's limit, of 1 N where it has none, below which its magnitude is smooth."""


@register
class PropellantCost(PlanCost):
    """Integral of the magnitudes of forces along each axis of driven bases, rounded off near zero."""

    unit: ClassVar[str] = "N s"
    reported: ClassVar[Literal["rms", "integral", "root"]] = "integral"
    weighs: ClassVar[str] = "forces on bases: give `limits.base_force`, or actuators of the base"

    kind: Literal["propellant"] = "propellant"
    weight: float = weight(
        "1/(N s)",
        "the impulse that propellant is spent for: the integral of the forces' magnitudes along each axis of "
        "driven bases; the search rounds them off below 1 % of their limit, the plan reports what is spent",
    )

    def magnitudes(self, instant: PlanInstant) -> ca.SX:
        """The forces."""
        return ca.vertcat(ca.SX(0, 1), *(base.force for base in instant.bases().values()))

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Magnitudes of the forces, smooth where they are small [N]."""
        found = ca.SX(0)
        for base in instant.bases().values():
            for k, limit in enumerate(base.force_limits):
                if limit:
                    small = SMOOTH * (limit if np.isfinite(limit) else 1.0)
                    found += ca.sqrt(base.force[k] ** 2 + small**2) - small
        return found
