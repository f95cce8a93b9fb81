"""Error of derivatives by the step: they are taken once more with steps of half the length.

Derivatives of a discrete rollout are exact for that rollout, whatever its step. Where steps are too coarse
for friction or another stiff law, its trajectory may be right to many digits while its derivatives are wrong
by factors: a perturbation grows along the discrete rollout that the true motion damps out. No estimate of a
single step's error shows that, so the derivatives themselves are compared.

Peaks are the largest values at steps. Up to half a step from a signal's maximum, the derivative is wrong by
as much times its rate, and half the step often leaves the peak where it is. Derivatives are therefore
compared with those at the maximum between steps of half the length (``loops/forward.hpp``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array

INACCURATE = 0.01
"""Part of a derivative by which half the step may change it."""

SMALL = 1e-4
"""A derivative counts as if it were no less than so much of the value over its parameter.

A change by half the step therefore counts from 1e-6 of the value over the parameter. At an optimum, where
derivatives vanish, the error of a certified step stays below that. A larger number passes, as exact, wrong
derivatives by parameters of little effect such as coefficients of friction.
"""


def inaccurate(
    gradient: Mapping[str, Array],
    finer: Mapping[str, Array],
    values: Mapping[str, Array],
    parameters: Array,
    paths: Sequence[str],
) -> str:
    """Reason why derivatives are inaccurate: half the step changes one by too much. Empty if none does.

    Args:
        gradient, finer: Derivatives (..., k) with the step and with half of it, by the name of what is
            differentiated.
        values: What is differentiated (...,), by name.
        parameters, paths: Values of the k parameters (k,), and their paths.
    """
    worst, reason = 0.0, ""
    for name, slopes in gradient.items():
        one, other = slopes.reshape(-1, len(paths)), finer[name].reshape(-1, len(paths))
        largest = np.abs(other).max(axis=0, initial=0.0)
        size = np.abs(values[name]).max(initial=0.0)
        # at an optimum derivatives vanish: what changes the value by less than this is nothing
        relative_size = np.divide(size, np.abs(parameters), out=np.zeros(len(paths)), where=parameters != 0)
        minimum_size = np.where(parameters != 0, relative_size, largest.max(initial=0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            change = np.abs(one - other).max(axis=0, initial=0.0)
            off = np.where(change > 0, change / np.maximum(largest, SMALL * minimum_size), 0.0)
        off = np.where(np.isnan(change), np.inf, off)
        if off.max(initial=0.0) > max(worst, INACCURATE):
            k = int(off.argmax())
            worst = float(off[k])
            part = f"{100 * worst:.0f} %" if worst < 10 else "more than 1000 %"
            reason = (
                f"inaccurate: step: half of it changes the derivative of '{name}' by '{paths[k]}' by {part}"
            )
    return reason
