"""Stay at the initial pose."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.desired_motion import STILL, TimeProfile
from spacerobot.elements.reference import Reference
from spacerobot.elements.registry import register
from spacerobot.elements.section_context import SectionContext


@register
class Hold(Reference):
    """Stay at the initial pose."""

    kind: Literal["hold"] = "hold"

    def moved(self, context: SectionContext) -> TimeProfile:
        """None."""
        del context
        return STILL
