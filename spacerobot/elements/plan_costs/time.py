"""The duration."""

from __future__ import annotations

from typing import ClassVar, Literal

from spacerobot.elements.plan_cost import PlanCost, weight
from spacerobot.elements.registry import register


@register
class TimeCost(PlanCost):
    """The duration."""

    unit: ClassVar[str] = "s"
    reported: ClassVar[Literal["rms", "integral", "root"]] = "integral"
    of: ClassVar[Literal["motion", "end", "duration"]] = "duration"

    kind: Literal["time"] = "time"
    weight: float = weight("1/s", "the duration")
