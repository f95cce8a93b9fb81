"""Jitter of tips: the part of their error above a corner frequency."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from spacerobot.quantities.quantity import AddedStates, Columns, Context, MeasuredScene, Quantity

PREFIX = "jitter."
NO_TIP = "no robot of this scene has a tip"


def low_passes(scene: MeasuredScene, frequency_hz: float) -> AddedStates:
    """Low passes of first order of the tips' errors, which begin at zero.

    With s' = 2 pi f (e - s) the error less its low pass, e - s, is e behind a high pass with the corner
    frequency f.
    """
    names = tuple(f"{PREFIX}{tip.label}[{axis}]" for tip in scene.tips for axis in "xyz")

    def rates(signals: Any, slow: ca.SX) -> ca.SX:
        return ca.SX(2 * np.pi * frequency_hz * (signals["tip_error"] - slow))

    return AddedStates(names, rates)


def fast_errors(context: Context) -> Columns:
    """Error of each tip after its high pass [m]."""
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
