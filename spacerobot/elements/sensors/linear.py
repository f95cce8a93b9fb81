"""Linear sensor (section 1.6 of the paper)."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor


@register
class Linear(LinearSensor):
    """Linear sensor S = a + b s, the same for every component of the signal (section 1.6)."""

    kind: Literal["linear"] = "linear"
