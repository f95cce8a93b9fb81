"""Attitude errors of bases that a controller holds."""

from __future__ import annotations

import casadi as ca
import numpy as np

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = 1e-12  # rad; keeps the angle smooth where it is zero
NO_ATTITUDE = "no robot of this scene holds its base's attitude by a controller of kind base_attitude"


def angles(context: Context) -> Components:
    """Attitude error of each controlled base [deg]."""
    names, errors = context.bodies("base_attitude_error")
    return Components(names, ca.vertcat(ca.SX(0, 1), *(180 / np.pi * e for e in sizes(errors, SMALLEST))))


def squares(context: Context) -> Components:
    """Squared attitude error of each controlled base [rad^2]."""
    names, errors = context.bodies("base_attitude_error")
    return Components(names, ca.vertcat(ca.SX(0, 1), *map(ca.sumsqr, errors)))


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
        "attitude_error_squared",
        "squared attitude error",
        "integral of the squared attitude errors of controlled bases",
        "rad^2 s",
        "integral",
        squares,
        total="sum",
        weight="base_attitude",
        weight_unit="objective/(rad^2 s)",
        is_metric=False,
        absent=NO_ATTITUDE,
    ),
)
