"""Star tracker."""

from __future__ import annotations

from typing import Literal

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors


@register
class StarTracker(LinearSensor):
    """Star tracker: attitude with white noise of 6 arc seconds at 4 Hz, known a period late.

    The noise is that of Crassidis and Junkins (2012), Optimal Estimation of Dynamic Systems: 0.005 deg
    (3 sigma) a sample.
    """

    kind: Literal["star_tracker"] = "star_tracker"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling, latency and noise; 29 urad a sample",
        default=SensorErrors(period=0.25, delay=0.25, noise=1.45e-5),
    )
