"""Joint encoder."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors


@register
class JointEncoder(LinearSensor):
    """Absolute encoder of joints: 19 bits a turn, read at 100 Hz.

    An assumption, not the data of a certain encoder: absolute encoders of robot joints have 16 to 20 bits.
    On the side of the motor it shows the motor's motion divided by the gear ratio, so that controllers do not
    see how the transmission bends; joints without a transmission move as their motors.
    """

    kind: Literal["joint_encoder"] = "joint_encoder"
    errors: SensorErrors | None = quantity(
        "1",
        "sampling and quantisation; 12 urad",
        default=SensorErrors(period=0.01, resolution=math.tau / 2**19),
    )
    side: Literal["link", "motor"] = Field(
        default="link", description="side of the transmission on which it is mounted"
    )

    @property
    def reads_motors(self) -> bool:
        """Whether the encoder is on the motor's side of a transmission."""
        return self.side == "motor"

    @property
    def is_ideal(self) -> bool:
        """Whether the encoder is on the link's side and a linear sensor without errors."""
        return super().is_ideal and self.side == "link"
