"""Approach cone: a tip approaches a mating frame inside a cone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from spacerobot.common.section import Vector, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, unit
from spacerobot.elements.limits.plan_limit import ApproachCone, PlanLimit


@register
class ApproachConeLimit(PlanLimit):
    """A tip approaches a mating frame inside a cone about its axis of approach."""

    short: ClassVar[str | None] = None

    kind: Literal["approach_cone"] = "approach_cone"
    tip: str = Field(description="which tip, as robot/tip")
    frame: str = Field(description="mating frame, a link of the target's URDF")
    axis: Vector = quantity("1", "direction of approach in the mating frame", default=(1.0, 0.0, 0.0))
    half_angle_deg: float = quantity("deg", "between its axis and its surface", gt=0, lt=90)
    radius: float = quantity("m", "of its cut in the mating frame's plane", default=0.01, gt=0)
    final_fraction: float = quantity(
        "1", "part of the duration, at its end, for which it holds", default=0.2, gt=0, le=1
    )

    @property
    def approach_cone(self) -> ApproachCone:
        """The cone."""
        return ApproachCone(self.frame, self.axis, self.half_angle_deg, self.radius)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Distance from the axis below the cone's radius there, smooth on the axis."""
        place = instant.tip(self.tip).seen_from(instant.mating(self.frame))[0]
        before, small = -ca.dot(unit(self.axis), place), self.radius / 10
        across = ca.sqrt(ca.sumsqr(place + before * unit(self.axis)) + small**2)
        slope = float(np.tan(np.radians(self.half_angle_deg)))
        upper = self.radius + small
        yield BoundedRow(
            "off the cone's axis",
            "m",
            across - slope * before,
            upper=upper,
            final_fraction=self.final_fraction,
        )
