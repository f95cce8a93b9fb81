"""Angular momentum stored in reaction wheels."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = 1e-12  # N m s; keeps the size smooth where it is zero
NO_WHEELS = "no robot of this scene has wheels, an actuator of kind reaction_wheels"


def stored(context: Context) -> Components:
    """Size of the momentum of all wheels of each base together [N m s]."""
    names, momenta = context.bodies("wheel_momentum")
    return Components(names, ca.vertcat(ca.SX(0, 1), *sizes(momenta, SMALLEST)))


def squares(context: Context) -> Components:
    """Squared momentum of all wheels of each base together [N^2 m^2 s^2]."""
    names, momenta = context.bodies("wheel_momentum")
    return Components(names, ca.vertcat(ca.SX(0, 1), *map(ca.sumsqr, momenta)))


QUANTITIES = (
    Quantity(
        "wheel_momentum_peak",
        "peak wheel momentum",
        "largest angular momentum of all wheels of a base together",
        "N m s",
        "peak",
        stored,
        limit="wheel_momentum",
        absent=NO_WHEELS,
        symbol="W",
    ),
    Quantity(
        "wheel_momentum_squared",
        "squared wheel momentum",
        "integral of the squared momentum of all wheels of each base together",
        "N^2 m^2 s^3",
        "integral",
        squares,
        total="sum",
        weight="wheel_momentum",
        weight_unit="objective/(N^2 m^2 s^3)",
        is_metric=False,
        absent=NO_WHEELS,
    ),
)
