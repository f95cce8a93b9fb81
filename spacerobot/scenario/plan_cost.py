"""Terms of a plan's cost, a weighted sum of quantities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import casadi as ca
from pydantic import Field

from spacerobot.common.errors import near_names
from spacerobot.common.section import OneOf, Section, matching, quantity
from spacerobot.quantities import Columns, Quantity, planned

if TYPE_CHECKING:
    from spacerobot.elements.goals.plan_instant import PlanInstant


class PlanCost(Section):
    """A term of the cost: a registered quantity of the motion, or its square for an RMS quantity.

    In a scenario, a number is the ``weight``, and the key is the kind if the section has none: ``torque:
        0.05``
    is ``torque: {kind: torque, weight: 0.05}``.
    """

    short: ClassVar[str] = "weight"

    kind: Annotated[str, OneOf(planned)] = Field(description="which quantity, by its key of plans")
    weight: float = quantity("SI", "weight of the quantity, of a root that of its squares", ge=0)
    factors: dict[str, Annotated[float, Field(ge=0)]] = Field(
        default={},
        description="factor of each component, of a root that of its square: robot/joint, or robot or grasp "
        "and axis as `arm x`; `*` matches any letters, a full name wins over a pattern; 1 where none is [1]",
    )

    @property
    def weighs(self) -> Quantity:
        """Quantity of the term."""
        return planned()[self.kind]

    def columns(self, instant: PlanInstant) -> Columns:
        """Columns of the quantity, multiplied by the factors, or by their square roots for an RMS quantity.

        Raises:
            ScenarioError: If a factor matches no component.
        """
        columns, factors = self.weighs.columns(instant), dict[str, float]()
        if not self.factors:
            return columns
        axes = {label: ("",) if one.numel() == 1 else (" x", " y", " z") for label, one in columns.items()}
        names = [f"{label}{axis}" for label in columns for axis in axes[label]]
        for pattern in sorted(self.factors, key=lambda pattern: "*" not in pattern):
            matched = matching(names, pattern)
            if not matched:
                raise instant.fault(f"no component {pattern!r}; {near_names(pattern, names)}", "factors")
            factors |= dict.fromkeys(matched, self.factors[pattern] ** (0.5 if self.weighs.is_root else 1))
        return {
            label: column * ca.vertcat(*(factors.get(f"{label}{axis}", 1.0) for axis in axes[label]))
            for label, column in columns.items()
        }

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Integrand, or terminal cost at the last instant, without the weight (1x1)."""
        return ca.sum1(self.weighs.entries(self.columns(instant)).values)
