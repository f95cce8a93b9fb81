"""Camera that measures the target's orientation."""

from __future__ import annotations

from typing import Literal

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors


@register
class CameraOrientation(LinearSensor):
    """Attitude of the target by a camera: 2 Hz, 0.3 s late, 0.5 deg nearby and 0.1 deg more for each metre.

    An assumption of the order of 1 deg, not the data of a certain camera.
    """

    kind: Literal["camera_orientation"] = "camera_orientation"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling, latency and noise; 0.5 deg a sample at no distance",
        default=SensorErrors(period=0.5, delay=0.3, noise=6.2e-3, noise_growth=0.2),
    )
