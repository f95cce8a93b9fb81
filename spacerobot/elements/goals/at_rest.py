"""Goal of a body at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from spacerobot.common.section import Name, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, matched, within, zero


@register
class Still(Goal):
    """A robot or the target is at rest at the end, with all bodies that grasps connect to it."""

    told_by: ClassVar[str | None] = "still"

    kind: Literal["still"] = "still"
    still: Name = Field(
        description="robot, or target, whose root link is at rest at the end, and, without `rest: false`, "
        "the bases and joints of all robots that hold the same object, and that object"
    )

    speed_within: float | None = quantity(
        "m/s", "maximum speed of the root link at the end; none if not given", default=None, gt=0
    )
    spin_within_deg: float | None = quantity(
        "deg/s", "maximum spin of the root link at the end; none if not given", default=None, gt=0
    )

    @property
    def body(self) -> str:
        """Name of the body that is at rest at the end."""
        return self.still

    @property
    def stops(self) -> str | None:
        """Name of that body, unless residual motion is allowed."""
        within = self.speed_within is not None or self.spin_within_deg is not None
        return self.still if self.rests and not within else None

    def resting(self, instant: PlanInstant) -> Iterator[Goal]:
        """Goals of rest for the body and for those joined to it by closed grasps, if rest is required."""
        for body in instant.joined(self.still, "still") if self.rests else ():
            yield self.model_copy(update={"still": body})

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Velocity and spin of its root link."""
        velocity, spin = instant.root(self.still, "still")
        yield from matched("velocity", "m/s", velocity, range(velocity.numel()), self.speed_within)
        if self.spin_within_deg is not None:
            yield within("spin", "rad/s", spin, float(np.radians(self.spin_within_deg)))
            return
        for axis, value in zip("xyz"[-spin.numel() :], ca.vertsplit(spin), strict=True):
            yield zero(f"spin {axis}", "rad/s", value)
