"""Motion along a straight line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from spacerobot.common.section import Vector, quantity
from spacerobot.elements.core.desired_motion import TimeProfile, along
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.references.reference import TimedReference


@register
class Line(TimedReference):
    """A straight line."""

    kind: Literal["line"] = "line"
    displacement: Vector = quantity("m", "from start to end, world axes", default=(0.0, 0.0, 0.0))

    def moved(self, context: SectionContext) -> TimeProfile:
        """Along the line, by the cubic blend."""
        return along(context.vector("displacement"), self.blend(context))

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """A rotation about another axis than z, or a displacement along it."""
        yield from super().leaves_plane()
        if self.displacement[2]:
            yield "displacement", list(self.displacement)
