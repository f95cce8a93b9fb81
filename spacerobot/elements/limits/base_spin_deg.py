"""Maximum angular velocity of any robot's floating base."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import PlanLimit
from spacerobot.section import quantity


@register
class BaseSpinLimit(PlanLimit):
    """Maximum angular velocity of any robot's floating base."""

    kind: Literal["base_spin_deg"] = "base_spin_deg"
    upper: float = quantity("deg/s", "maximum angular velocity relative to the world's axes", gt=0)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Constraint on the spin of each base."""
        limit = float(np.radians(self.upper))
        for name, base in instant.bases().items():
            yield within(f"spin of {name}'s base", "rad/s", base.frame.spin, limit)
