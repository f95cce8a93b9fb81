"""A joint encoder."""

from __future__ import annotations

import math
from typing import Literal

from spacerobot.elements.linear_sensor import LinearSensor
from spacerobot.elements.measurement import SensorErrors
from spacerobot.elements.registry import register
from spacerobot.section import quantity


@register
class JointEncoder(LinearSensor):
    """Absolute encoder of joints: 19 bits a turn, read at 100 Hz.

    An assumption, not the data of a certain encoder: absolute encoders of robot joints have 16 to 20 bits.
    """

    kind: Literal["joint_encoder"] = "joint_encoder"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling and quantisation; 12 urad",
        default=SensorErrors(period=0.01, resolution=math.tau / 2**19),
    )
