"""Impulse that propellant is spent for."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class PropellantCost(PlanCost):
    """Integral of the magnitudes of forces along each axis of driven bases."""

    unit: ClassVar[str] = "N s"
    reported: ClassVar[Literal["rms", "integral", "root"]] = "integral"
    weighs: ClassVar[str] = "forces on bases: give `limits.base_force`, or actuators of the base"

    kind: Literal["propellant"] = "propellant"
    weight: float = weight(
        "1/(N s)",
        "the impulse that propellant is spent for: the integral of the forces' magnitudes along each axis of "
        "driven bases",
    )

    def magnitudes(self, instant: PlanInstant) -> ca.SX:
        """The forces along axes that are driven."""
        forces = ca.vertcat(ca.SX(0, 1), *(base.force for base in instant.bases().values()))
        return forces[forces.sparsity().row()]

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Nothing where no forces act, whose magnitudes alone count."""
        del instant
        return ca.SX(0)
