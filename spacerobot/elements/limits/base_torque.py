"""Maximum torque on a floating base, by axis of its root link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import PlanLimit, WrenchPart
from spacerobot.section import quantity


@register
class BaseTorqueLimit(PlanLimit):
    """Maximum torque on a floating base, by axis of its root link."""

    kind: Literal["base_torque"] = "base_torque"
    upper: float = quantity(
        "N m", "maximum torque about each axis that drives a floating base, 0 for none; likewise", ge=0
    )

    def base_limits(self) -> Mapping[WrenchPart, float]:
        """The torque."""
        return {"torque": self.upper}
