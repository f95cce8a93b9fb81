"""Attitude errors of bases that a controller holds."""

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
        "attitude_error_peak",
        "peak attitude error",
        "largest attitude error of a controlled base",
        "deg",
        "peak",
        angles,
        limit="attitude_error_deg",
        absent=NO_ATTITUDE,
        symbol="A",
    ),
    Quantity(
        "attitude_error_rms",
        "RMS attitude error",
        "root mean square of the attitude error of a controlled base",
        "rad",
        "rms",
        "base_attitude_error",
        total="norm",
        weight="base_attitude",
        is_default=False,
        absent=NO_ATTITUDE,
    ),
)
