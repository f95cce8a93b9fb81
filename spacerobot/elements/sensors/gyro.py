"""Rate gyro."""

from __future__ import annotations

from typing import Literal

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors


@register
class Gyro(LinearSensor):
    """Rate gyro of navigation grade: white noise and a random-walk bias, sampled at 100 Hz.

    The densities are those of Crassidis and Markley (2003), Unscented filtering for spacecraft attitude
    estimation, Journal of Guidance, Control, and Dynamics 26(4): 0.316 urad/s^0.5 and 0.316 nrad/s^1.5,
    an initial bias of 0.1 deg/h.
    """

    kind: Literal["gyro"] = "gyro"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling and noise",
        default=SensorErrors(period=0.01, noise=3.16e-7, bias=4.85e-7, bias_walk=3.16e-10),
    )
