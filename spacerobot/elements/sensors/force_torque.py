r"""Force-torque sensor at the tip of an arm, or at one of its joints.

Let D be the bodies beyond the sensor. It measures the wrench that they transmit to the arm,

$$ w = \sum_{i \in D} w_i^\text{ext} - \sum_{i \in D} \begin{bmatrix}
   m_i (a_i - g) \\ \dot h_i - c_i \times m_i g \end{bmatrix}, $$

with forces and torques of contacts and grasps, masses $m_i$, accelerations $a_i$ of the centres of mass
$c_i$, angular momenta $h_i$, and the acceleration $g$ of gravity there; all torques are about the tip's
origin, in world axes. The second sum is what the tool takes to move as it does. A sensor that compensates for
it knows the tool and its motion, and shows the first sum alone.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.elements.sensors.measurement import SensorErrors
from spacerobot.elements.sensors.sensor import Flange


@register
class ForceTorque(LinearSensor):
    """Force-torque sensor at a tip or a joint: force or torque on the tip, sampled at 200 Hz.

    It provides the signals `tip_force` and `tip_torque`. The sampling rate is an assumption, not the data of
    a particular sensor.
    """

    kind: Literal["force_torque"] = "force_torque"
    errors: SensorErrors | None = quantity(
        "1", "sampling, noise, bias, resolution and range", default=SensorErrors(period=0.005)
    )
    joint: str | None = Field(
        default=None,
        description="joint of the URDF through which the wrench is measured, fixed or not; at the tip if not "
        "given",
    )
    compensated: bool = Field(
        default=False,
        description="whether weight and inertia of the links beyond the joint are subtracted, as computed "
        "from their exact motion",
    )

    @property
    def measures_wrench(self) -> bool:
        """True."""
        return True

    @property
    def flange(self) -> Flange:
        """Joint of the sensor, and whether the links beyond it are compensated."""
        return Flange(self.joint, self.compensated or self.joint is None)

    @property
    def is_ideal(self) -> bool:
        """Whether it reads the wrench on the tip at all times without errors."""
        return super().is_ideal and self.joint is None
