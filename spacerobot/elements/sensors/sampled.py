"""Sensor that measures at sample instants."""

from __future__ import annotations

from typing import ClassVar, Literal

from spacerobot.common.section import MAX_SAMPLES, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor


@register
class Sampled(LinearSensor):
    """Measures a + b s at the start and then once in each period, and holds the value until the next one."""

    kind: Literal["sampled"] = "sampled"
    holds: ClassVar[bool] = True
    period: float = quantity("s", "time between two measurements", default=0.1, gt=0, recurs=MAX_SAMPLES)

    @property
    def is_ideal(self) -> bool:
        """False: its measurements are held between samples."""
        return False
