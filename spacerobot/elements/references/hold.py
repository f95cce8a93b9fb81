"""Stay at the initial pose."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.motion import STILL, Profile
from spacerobot.elements.numbers import Context
from spacerobot.elements.reference import Reference
from spacerobot.elements.registry import register


@register
class Hold(Reference):
    """Stay at the initial pose."""

    kind: Literal["hold"] = "hold"

    def moved(self, context: Context) -> Profile:
        """None."""
        del context
        return STILL
