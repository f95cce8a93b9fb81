"""Limits that every planned joint must have in its URDF."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import PlanLimit, PlannedJoint


@register
class UrdfLimits(PlanLimit):
    """Limits that every planned joint must have in its URDF; existing limits always apply."""

    short: ClassVar[str | None] = "required"

    kind: Literal["urdf"] = "urdf"
    required: tuple[Literal["position", "rate", "torque"], ...] = Field(
        description="limits that every planned joint must have in its URDF"
    )

    def faults(self, joint: PlannedJoint) -> Iterator[str]:
        """Limits that a joint lacks."""
        for key in self.required:
            if key not in joint.limited:
                yield (
                    f"{joint.label} has no {key} limit in {joint.file}; give it there, or leave {key!r} out"
                )
