"""Attitude errors of bases with attitude control."""

from __future__ import annotations

import numpy as np

from spacerobot.quantities.quantity import Columns, Quantity, SignalSource, sizes

SMALLEST = 1e-12  # rad; keeps the angle smooth where it is zero
NO_ATTITUDE = "no robot of this scene holds its base's attitude by a controller of kind base_attitude"


def angles(source: SignalSource) -> Columns:
    """Attitude error of each controlled base [deg]."""
    return sizes(source.signal("base_attitude_error"), SMALLEST, 180 / np.pi)


QUANTITIES = (
    Quantity(
        name="attitude_error_peak",
        label="peak attitude error",
        description="largest attitude error of a controlled base",
        unit="deg",
        reducer="peak",
        expression=angles,
        limit="attitude_error_deg",
        absent=NO_ATTITUDE,
        symbol="A",
    ),
    Quantity(
        name="attitude_error_rms",
        label="RMS attitude error",
        description="root mean square of the attitude error of a controlled base",
        unit="rad",
        reducer="rms",
        expression="base_attitude_error",
        total="norm",
        weight="base_attitude",
        is_default=False,
        absent=NO_ATTITUDE,
    ),
)
