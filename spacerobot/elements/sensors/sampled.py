"""Sensor that measures at sample instants."""

from __future__ import annotations

from typing import ClassVar, Literal

from spacerobot.common.section import MAX_SAMPLES, SIGNALS_UNIT, quantity
from spacerobot.elements.core.context import Affine
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.sensors.sensor import Sensor


@register
class Sampled(Sensor):
    """Measures a + b s at the start and then once in each period, and holds the value until the next one."""

    kind: Literal["sampled"] = "sampled"
    holds: ClassVar[bool] = True
    period: float = quantity("s", "time between two measurements", default=0.1, gt=0, recurs=MAX_SAMPLES)
    offset: float = quantity(SIGNALS_UNIT, "a", default=0.0)
    scale: float = quantity("1", "b", default=1.0)

    def affine(self, context: SectionContext) -> Affine:
        """Offset and scale of the measurement; both are numbers of the section."""
        return context.number("offset"), context.number("scale")

    @property
    def is_ideal(self) -> bool:
        """False: its measurements are held between samples."""
        return False
