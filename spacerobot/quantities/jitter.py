"""Jitter of tips: the part of their error above a corner frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from spacerobot.quantities.quantity import NOTHING, AddedStates, Components, Context, Quantity

if TYPE_CHECKING:
    from spacerobot.scene import Scene

PREFIX = "jitter."
NO_TIP = "no robot of this scene has a tip"


def low_passes(scene: Scene, frequency_hz: float) -> AddedStates:
    """Low passes of first order of the tips' errors, which begin at zero.

    With s' = 2 pi f (e - s) the error less its low pass, e - s, is e behind a high pass with the corner
    frequency f.
    """
    names = tuple(f"{PREFIX}{tip.label}[{axis}]" for tip in scene.tips for axis in "xyz")

    def rates(signals: Any, slow: ca.SX) -> ca.SX:
        return ca.SX(2 * np.pi * frequency_hz * (signals["tip_error"] - slow))

    return AddedStates(names, rates)


def squares(context: Context) -> Components:
    """Squared jitter of each tip [m^2]."""
    places = [i for i, name in enumerate(context.loop.state_names) if name.startswith(PREFIX)]
    if not places:
        return NOTHING
    fast = context.signals["tip_error"] - context.signals.x[places]
    tips = context.scene.tips
    values = [ca.sumsqr(fast[3 * i : 3 * i + 3]) for i in range(len(tips))]
    return Components(tuple(tip.label for tip in tips), ca.vertcat(*values))


QUANTITIES = (
    Quantity(
        "jitter",
        "jitter",
        "root mean square of a tip's error after a first-order high-pass filter",
        "m",
        "rms",
        squares,
        limit="jitter",
        is_default=False,
        absent=NO_TIP,
        symbol="J",
        states=low_passes,
    ),
    Quantity(
        "jitter_squared",
        "squared jitter",
        "integral of the tips' squared jitter: their error after a first-order high-pass filter",
        "m^2 s",
        "integral",
        squares,
        total="sum",
        weight="jitter",
        weight_unit="objective/(m^2 s)",
        is_metric=False,
        absent=NO_TIP,
        states=low_passes,
    ),
)
