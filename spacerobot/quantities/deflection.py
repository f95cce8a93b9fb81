"""Deflections of flexible links, and coordinates of their modes."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = 1e-12  # m; keeps the size smooth where it is zero


def of_ends(context: Context) -> Components:
    """Deflection of the ends of beams [m]."""
    has_beams = "deflection" in context.signals.outputs
    values = list(sizes(context.vectors("deflection"), SMALLEST)) if has_beams else []
    return Components(("total",) * len(values), ca.vertcat(ca.SX(0, 1), *values))


def of_modes(context: Context) -> Components:
    """Size of the coordinates of modes [kg^(1/2) m]."""
    values = ca.fabs(context.signals.outputs.get("modal_coordinate", ca.SX(0, 1)))
    return Components(("total",) * values.numel(), values)


QUANTITIES = (
    Quantity(
        "deflection_peak",
        "peak deflection",
        "largest deflection of the end of a flexible link of kind beam",
        "m",
        "peak",
        of_ends,
        limit="deflection",
        absent="no flexible link of this scene is of kind beam",
        symbol="D",
    ),
    Quantity(
        "modal_coordinate_peak",
        "peak modal coordinate",
        "largest mass-normalised coordinate of a mode of a flexible link",
        "kg^(1/2) m",
        "peak",
        of_modes,
        limit="modal_coordinate",
        absent="no flexible link of this scene is of kind modes",
        symbol="V",
    ),
)
