"""Jitter of tips: their error after a first-order high-pass filter."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from spacerobot.quantities.quantity import AddedStates, Columns, Context, MeasuredScene, Quantity

PREFIX = "jitter."
NO_TIP = "no robot of this scene has a tip"


def low_passes(scene: MeasuredScene, frequency_hz: float) -> AddedStates:
    """States of first-order low-pass filters of the tip errors, initially zero.

    With s' = 2 pi f (e - s), the difference e - s is the error e after a first-order high-pass filter with
    the corner frequency f, since 1 - w/(p + w) = p/(p + w) in the Laplace variable p, with w = 2 pi f.
    """
    names = tuple(f"{PREFIX}{tip.label}[{axis}]" for tip in scene.tips for axis in "xyz")

    def rates(signals: Any, slow: ca.SX) -> ca.SX:
        return ca.SX(2 * np.pi * frequency_hz * (signals["tip_error"] - slow))

    return AddedStates(names, rates)


def fast_errors(context: Context) -> Columns:
    """Error of each tip after the high-pass filter (3x1) [m]."""
    names = context.loop.state_names
    return {
        label: error - context.signals.x[[names.index(f"{PREFIX}{label}[{axis}]") for axis in "xyz"]]
        for label, error in context.signal("tip_error").items()
        if f"{PREFIX}{label}[x]" in names
    }


QUANTITIES = (
    Quantity(
        name="jitter",
        label="jitter",
        description="root mean square of a tip's error after a first-order high-pass filter",
        unit="m",
        reducer="rms",
        expression=fast_errors,
        limit="jitter",
        weight="jitter",
        is_default=False,
        absent=NO_TIP,
        symbol="J",
        states=low_passes,
    ),
)
