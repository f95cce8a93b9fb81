"""Maximum force on a floating base, by axis of its root link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import PlanLimit, WrenchPart
from spacerobot.section import quantity


@register
class BaseForceLimit(PlanLimit):
    """Maximum force on a floating base, by axis of its root link."""

    kind: Literal["base_force"] = "base_force"
    upper: float = quantity(
        "N",
        "maximum force along each axis that drives a floating base, 0 for none; that of its actuators if "
        "not given",
        ge=0,
    )

    def base_limits(self) -> Mapping[WrenchPart, float]:
        """The force."""
        return {"force": self.upper}
