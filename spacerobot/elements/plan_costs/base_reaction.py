"""Integral of squared forces and torques of arms on their bases."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register
from spacerobot.section import quantity


@register
class BaseReactionCost(PlanCost):
    """Integral of squared forces and torques that arms put on their bases, about the root link's origin."""

    unit: ClassVar[str] = "N"

    kind: Literal["base_reaction"] = "base_reaction"
    weight: float = weight(
        "1/(N^2 s)", "the integral of squared forces [N] and torques [N m] of arms on their bases"
    )
    force: float = quantity("1", "factor of the squared forces", default=1.0, ge=0)
    torque: float = quantity("1", "factor of the squared torques", default=1.0, ge=0)

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        found = ca.SX(0)
        for force, torque in instant.base_reactions().values():
            found += self.force * ca.sumsqr(force) + self.torque * ca.sumsqr(torque)
        return found
