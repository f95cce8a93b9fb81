"""A sensor of one's own: one whose errors grow with its temperature.

spacerobot run paper --plugin thermal.py --set 'robots.*.sensors.joint_rate={kind: thermal, temperature: 45}'
"""

from typing import Literal

import spacerobot as sr
from spacerobot.elements import SIGNALS_UNIT, Affine, SectionContext, Sensor, quantity

CALIBRATED = 20.0


@sr.register
class Thermal(Sensor):
    """Sensor with an offset and a scale error that are proportional to its temperature above 20 degC."""

    kind: Literal["thermal"] = "thermal"
    temperature: float = quantity("degC", "temperature of the sensor", default=CALIBRATED)
    offset_by_kelvin: float = quantity(f"({SIGNALS_UNIT})/K", "offset by temperature", default=0.0)
    scale_by_kelvin: float = quantity("1/K", "scale error by temperature", default=1e-3)

    def affine(self, context: SectionContext) -> Affine:
        """Reading ``a dT + (1 + b dT) s`` of the signal s."""
        above = context.number("temperature") - CALIBRATED
        return context.number("offset_by_kelvin") * above, 1 + context.number("scale_by_kelvin") * above

    @property
    def is_ideal(self) -> bool:
        """Whether it reads the signal as it is: at the temperature of its calibration."""
        return self.temperature == CALIBRATED or not (self.offset_by_kelvin or self.scale_by_kelvin)
