"""A cost and a limit of plans of one's own: the speed of a tip.

spacerobot plan reach.yaml --plugin tip_speed.py --set 'plan.limits.tip_speed={upper: 0.2, tip: arm/tip}'
"""

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

import spacerobot as sr
from spacerobot.elements import BoundedRow, PlanCost, PlanInstant, PlanLimit, quantity, within


@sr.register
class TipSpeedCost(PlanCost):
    """Integral of the squared speed of a tip."""

    unit: ClassVar[str] = "m/s"

    kind: Literal["tip_speed"] = "tip_speed"
    weight: float = quantity("s/m^2", "weight of the integral of the tip's squared speed", ge=0)
    tip: str = Field(description="which tip, as robot/tip")

    def expression(self, instant: PlanInstant) -> ca.SX:
        """The squared speed."""
        return ca.sumsqr(instant.tip(self.tip).velocity)


@sr.register
class TipSpeedLimit(PlanLimit):
    """Greatest speed of a tip."""

    kind: Literal["tip_speed"] = "tip_speed"
    upper: float = quantity("m/s", "greatest speed", gt=0)
    tip: str = Field(description="which tip, as robot/tip")

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """One row."""
        yield within(f"speed of {self.tip}", "m/s", instant.tip(self.tip).velocity, self.upper)
