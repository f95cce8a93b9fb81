"""Tip errors: reference minus position."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Columns, Context, Quantity


def along_axes(context: Context) -> Columns:
    """Absolute error of each tip along each world axis of translation [m]."""
    errors, axes = context.signal("tip_error"), context.scene.translation_axes
    return {f"{tip} {'xyz'[k]}": ca.fabs(error[k]) for tip, error in errors.items() for k in axes}


NO_TIP = "no robot of this scene has a tip"

QUANTITIES = (
    Quantity(
        name="tip_error_peak",
        label="peak tip error (one axis)",
        description="largest error of a tip along an axis, at any time",
        unit="m",
        reducer="peak",
        expression=along_axes,
        limit="tip_error",
        absent=NO_TIP,
        symbol="E",
    ),
    Quantity(
        name="tip_error_rms",
        label="RMS tip error",
        description="root mean square of the tip error over time",
        unit="m",
        reducer="rms",
        expression="tip_error",
        total="norm",
        absent=NO_TIP,
    ),
)
