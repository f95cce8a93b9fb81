"""Stiffness of a closed loop: its fastest rate, and the gains that determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spacerobot.arrays import Array
from spacerobot.closedloop.closed_loop import ClosedLoop

GAINS = frozenset(
    {
        *("kp", "ki", "kd", "filter_time", "ge", "ta", "damping", "stiffness"),
        *("rotational_stiffness", "rotational_damping"),
    }
)
"""Last parts of the paths of what a user may soften."""
_INCREMENT, _CHANGE, _SHARE = 1e-6, 1.1, 0.25


@dataclass(frozen=True)
class FastestRate:
    """Largest eigenvalue of the linearised loop where it begins.

    Attributes
    ----------
    per_s
        Its absolute value [1/s]; the method of Runge and Kutta needs steps below 2.8 over it.
    gains
        At most two paths of those it follows most: with the gain to a power of a quarter or more.
    """

    per_s: float
    gains: tuple[str, ...]


def find_fastest_rate(loop: ClosedLoop) -> FastestRate | None:
    """Fastest rate at the start, by central differences; None if the loop cannot be evaluated there."""
    rate = _fastest(loop, loop.parameter_values)
    if not 0 < rate < np.inf:
        return None
    follows = {}
    for i, path in enumerate(loop.parameter_paths):
        if path.rpartition(".")[2] in GAINS and loop.parameter_values[i] != 0:
            values = np.array(loop.parameter_values)
            values[i] *= _CHANGE
            share = abs(np.log(_fastest(loop, values) / rate) / np.log(_CHANGE))
            if share >= _SHARE:
                follows[path] = share
    # rounded, so that of alike robots the first is named first
    strongest = sorted(follows, key=lambda path: -round(follows[path], 1))[:2]
    return FastestRate(rate, tuple(strongest))


def _fastest(loop: ClosedLoop, values: Array) -> float:
    """Largest absolute eigenvalue of the Jacobian of x' at the start; NaN where there is none."""
    x0, c = loop.setup(values)
    start = x0.full()
    shifts = _INCREMENT * np.eye(start.size)
    rates = loop.dynamics(0.0, np.hstack([start + shifts, start - shifts]), c).full()
    jacobian = (rates[:, : start.size] - rates[:, start.size :]) / (2 * _INCREMENT)
    if not np.isfinite(jacobian).all():
        return float("nan")
    return float(np.abs(np.linalg.eigvals(jacobian)).max())
