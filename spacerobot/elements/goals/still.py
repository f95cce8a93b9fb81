"""A body at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.elements.goal import Goal
from spacerobot.elements.instant import Instant, Row, zero
from spacerobot.elements.registry import register
from spacerobot.section import Name


@register
class Still(Goal):
    """A robot or the target comes to rest."""

    told_by: ClassVar[str | None] = "still"

    kind: Literal["still"] = "still"
    still: Name = Field(description="robot, or target, whose root link is at rest at the end")

    @property
    def body(self) -> str:
        """The one that comes to rest."""
        return self.still

    def rows(self, instant: Instant) -> Iterator[Row]:
        """Velocity and spin of its root link."""
        velocity, spin = instant.root(self.still, "still")
        for axis, value in zip("xyz", ca.vertsplit(velocity), strict=False):
            yield zero(f"velocity {axis}", "m/s", value)
        for axis, value in zip("xyz"[-spin.numel() :], ca.vertsplit(spin), strict=True):
            yield zero(f"spin {axis}", "rad/s", value)
