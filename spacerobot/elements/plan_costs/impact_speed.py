"""Squared speeds with which tips arrive at their mating frames."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class ImpactSpeedCost(PlanCost):
    """Squared speeds and spins with which tips arrive at their mating frames, at the last instant."""

    unit: ClassVar[str] = "m/s"
    reported: ClassVar[Literal["rms", "integral", "root"]] = "root"
    of: ClassVar[Literal["motion", "end", "duration"]] = "end"
    weighs: ClassVar[str] = "tips that reach mating frames: give a goal with `frame`"

    kind: Literal["impact_speed"] = "impact_speed"
    weight: float = weight(
        "s^2/m^2",
        "the squared speeds [m/s] and spins [rad/s] with which tips reach their mating frames",
    )

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        found = ca.SX(0)
        for speed, spin in instant.arrivals():
            found += ca.sumsqr(speed) + ca.sumsqr(spin)
        return found
