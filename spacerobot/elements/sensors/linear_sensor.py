"""Sensors whose reading is a + b s (section 1.6 of the paper)."""

from __future__ import annotations

from spacerobot.common.section import SIGNALS_UNIT, quantity
from spacerobot.elements.core.context import Affine
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.sensors.sensor import Sensor


class LinearSensor(Sensor):
    """A sensor S = a + b s, the same for every component of the signal."""

    offset: float = quantity(SIGNALS_UNIT, "a", default=0.0)
    scale: float = quantity("1", "b", default=1.0)

    def affine(self, context: SectionContext) -> Affine:
        """Offset and scale from the section."""
        return context.number("offset"), context.number("scale")

    @property
    def is_ideal(self) -> bool:
        """Whether a is 0 and b is 1 without variation, noise and failures."""
        return self.offset == 0 and self.scale == 1 and self.errors is None and self.failure is None
