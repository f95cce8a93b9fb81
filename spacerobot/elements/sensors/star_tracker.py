"""A star tracker."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.measurement import SensorErrors
from spacerobot.elements.registry import register
from spacerobot.elements.sensors.linear import Linear
from spacerobot.section import quantity


@register
class StarTracker(Linear):
    """Star tracker: attitude with white noise of 6 arc seconds at 4 Hz, known a period late.

    The noise is that of Crassidis and Junkins (2012), Optimal Estimation of Dynamic Systems: 0.005 deg
    (3 sigma) a sample.
    """

    kind: Literal["star_tracker"] = "star_tracker"  # type: ignore[assignment]
    errors: SensorErrors | None = quantity(
        "1",
        "sampling, latency and noise; 29 urad a sample",
        default=SensorErrors(period=0.25, delay=0.25, noise=1.45e-5),
    )
