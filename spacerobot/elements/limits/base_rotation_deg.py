"""Maximum rotation of any robot's base since the start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class BaseRotationLimit(PlanLimit):
    """Maximum rotation of any robot's base since the start."""

    relative_to_start: ClassVar[bool] = True

    kind: Literal["base_rotation_deg"] = "base_rotation_deg"
    upper: float = quantity("deg", "maximum rotation of any robot's base since the start", gt=0, lt=180)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the rotation vector of each base."""
        for name, base in instant.bases().items():
            yield within(f"rotation of {name}'s base", "rad", base.rotation, float(np.radians(self.upper)))
