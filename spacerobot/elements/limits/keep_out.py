"""Keep-out zone: a minimum distance between two shapes or groups of shapes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant
from spacerobot.elements.limits.plan_limit import PlanLimit, SeparatedShapes
from spacerobot.elements.shapes.collision_shape import Wrap


@register
class KeepOut(PlanLimit):
    """Two shapes, or groups of them, that stay apart."""

    short: ClassVar[str | None] = None

    kind: Literal["keep_out"] = "keep_out"
    between: tuple[str, str] = Field(
        description="the pair, each the name of a pad, or robot/link or target/link for all collision shapes "
        "of a link; `*` in a link's name matches any letters"
    )
    distance: float = quantity("m", "minimum distance", default=0.0, ge=0)
    wrap: Wrap | None = Field(
        default=None, description="shape around meshes and cylinders that replaces them"
    )
    only: tuple[int, ...] | None = Field(
        default=None,
        description="which pairs of their shapes, counted from 0 as the URDFs list them, the second side's "
        "first; all if not given",
    )

    @property
    def separated(self) -> SeparatedShapes:
        """The two."""
        return SeparatedShapes(self.between, self.wrap)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """The distance of each pair."""
        for k, (label, gap, about, fastest) in enumerate(instant.gaps(self.between, self.wrap)):
            if self.only is not None and k not in self.only:
                continue
            yield BoundedRow(label, "m", gap, lower=self.distance, about=about, fastest=fastest)
