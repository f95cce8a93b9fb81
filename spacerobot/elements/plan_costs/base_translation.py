"""Integral of the robots' squared base displacements since the start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca

from spacerobot.elements.plan_cost import AxesCost, weight
from spacerobot.elements.plan_instant import PlanInstant
from spacerobot.elements.registry import register


@register
class BaseTranslationCost(AxesCost):
    """Integral of the robots' squared base displacements since the start."""

    unit: ClassVar[str] = "m"
    weighs: ClassVar[str] = "floating bases of robots"
    relative_to_start: ClassVar[bool] = True

    kind: Literal["base_translation"] = "base_translation"
    weight: float = weight(
        "1/(m^2 s)",
        "the integral of the robots' squared base displacements since the start, world axes",
    )

    def vectors(self, instant: PlanInstant) -> Iterator[ca.SX]:
        """Of each floating base."""
        for base in instant.bases().values():
            yield base.translation
