"""Error of derivatives due to the step: comparison with derivatives at half the step.

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
"""Maximum relative change of a derivative when the step is halved."""

SMALL = 1e-4
"""Floor of the derivative's magnitude in the comparison, in units of value / parameter.

A change is therefore reported only above 1e-6 value / parameter. At an optimum, where derivatives vanish, the
error of a certified step stays below that. A larger floor would accept wrong derivatives with respect to
parameters of little effect, such as friction coefficients.
"""


def inaccurate(
    gradient: Mapping[str, Array],
    finer: Mapping[str, Array],
    values: Mapping[str, Array],
    parameters: Array,
    paths: Sequence[str],
) -> str:
    """Reason why derivatives are inaccurate (one changes too much at half the step), or an empty string.

    Args:
        gradient, finer: Derivatives (..., k) with the step and with half of it, by the name of the
            differentiated value.
        values: Differentiated values (...,), by name.
        parameters, paths: Values of the k parameters (k,), and their paths.
    """
    worst, reason = 0.0, ""
    for name, slopes in gradient.items():
        coarse, fine = slopes.reshape(-1, len(paths)), finer[name].reshape(-1, len(paths))
        largest = np.abs(fine).max(axis=0, initial=0.0)
        size = np.abs(values[name]).max(initial=0.0)
        # at an optimum derivatives vanish: what changes the value by less than this is nothing
        relative_size = np.divide(size, np.abs(parameters), out=np.zeros(len(paths)), where=parameters != 0)
        minimum_size = np.where(parameters != 0, relative_size, largest.max(initial=0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            change = np.abs(coarse - fine).max(axis=0, initial=0.0)
            off = np.where(change > 0, change / np.maximum(largest, SMALL * minimum_size), 0.0)
        off = np.where(np.isnan(change), np.inf, off)
        if off.max(initial=0.0) > max(worst, INACCURATE):
            k = int(off.argmax())
            worst = float(off[k])
            part = f"{100 * worst:.0f} %" if worst < 10 else "more than 1000 %"
            change_text = f"the derivative of '{name}' by '{paths[k]}' by {part}"
            reason = f"inaccurate: step: half the step changes {change_text}"
    return reason
