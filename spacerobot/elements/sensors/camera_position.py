"""Camera that measures the target's position."""

from __future__ import annotations

from typing import Literal

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors


@register
class CameraPosition(LinearSensor):
    """Position of the target by a camera: 2 Hz, 0.3 s late, 5 mm nearby and 5 mm more for each metre.

    An assumption of the order of 1 % of the distance, not the data of a certain camera.
    """

    kind: Literal["camera_position"] = "camera_position"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling, latency and noise; 5 mm a sample at no distance",
        default=SensorErrors(period=0.5, delay=0.3, noise=3.5e-3, noise_growth=1.0),
    )
