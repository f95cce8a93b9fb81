"""Hold of the initial pose."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.core.desired_motion import STILL, TimeProfile
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.references.reference import Reference


@register
class Hold(Reference):
    """Stay at the initial pose."""

    kind: Literal["hold"] = "hold"

    def moved(self, context: SectionContext) -> TimeProfile:
        """Zero displacement."""
        del context
        return STILL
