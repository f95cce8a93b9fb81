"""Errors of tips: reference minus position."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity


def along_axes(context: Context) -> Components:
    """Absolute error of each tip along each axis that it can move along [m]."""
    scene = context.scene
    axes = scene.translation_axes
    rows = [3 * i + axis for i in range(len(scene.tips)) for axis in axes]
    labels = tuple(f"{tip.label} {'xyz'[axis]}" for tip in scene.tips for axis in axes)
    return Components(labels, ca.fabs(context.signals["tip_error"][rows]))


def squared_distances(context: Context) -> Components:
    """Squared distance of each tip from its reference [m^2]."""
    squares = [ca.sumsqr(error) for error in context.vectors("tip_error")]
    return Components(tuple(tip.label for tip in context.scene.tips), ca.vertcat(ca.SX(0, 1), *squares))


NO_TIP = "no robot of this scene has a tip"

QUANTITIES = (
    Quantity(
        "tip_error_peak",
        "peak tip error (one axis)",
        "largest error of a tip along an axis, at any time",
        "m",
        "peak",
        along_axes,
        limit="tip_error",
        absent=NO_TIP,
        symbol="E",
    ),
    Quantity(
        "tip_error_rms",
        "RMS tip error",
        "root mean square of the tip error over time",
        "m",
        "rms",
        squared_distances,
        total="norm",
        absent=NO_TIP,
    ),
)
