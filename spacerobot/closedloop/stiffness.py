"""Stiffness of a closed loop: its fastest rate, and the gains that determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spacerobot.closedloop.closed_loop import ClosedLoop
from spacerobot.common.arrays import Array

GAINS = frozenset(
    {
        *("kp", "ki", "kd", "filter_time", "ge", "ta", "damping", "stiffness"),
        *("rotational_stiffness", "rotational_damping"),
    }
)
"""Last words of the paths of gains that a user may reduce."""
_INCREMENT, _CHANGE, _SHARE = 1e-3, 1.1, 0.25


@dataclass(frozen=True)
class FastestRate:
    """Largest eigenvalue of the linearised loop at the initial state.

    Attributes:
        per_s: Magnitude [1/s]; the Runge-Kutta method needs steps below 2.8 over it.
        gains: Paths of the at most two gains with the largest sensitivity d ln(rate) / d ln(gain), of
            magnitude 1/4 or more.
    """

    per_s: float
    gains: tuple[str, ...]


def find_fastest_rate(loop: ClosedLoop) -> FastestRate | None:
    """Fastest rate at the start, by finite differences; None if the loop cannot be evaluated there."""
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


def find_poles(loop: ClosedLoop, time_s: float, x: Array, c: Array) -> Array:
    """Poles of the closed loop about an instant, by differences of fourth order.

    x has more coordinates than degrees of freedom, and works and momentum are integrals: each adds a pole at
    zero to those of the motion.

    Args:
        loop: The closed loop.
        time_s: Time [s].
        x, c: State (nx,) and constants (nc,) with the switches at that time.

    Returns:
        numpy.ndarray: Eigenvalues (nx,) of the Jacobian of x' [1/s]; NaN if it is not finite.
    """
    # (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h, with errors of h^4 and of rounding over h: a
    # Jordan block of k zeros is split by the k-th root of both
    shift = _INCREMENT * np.eye(x.size)
    perturbed = np.hstack([np.reshape(x, (-1, 1)) + factor * shift for factor in (1, -1, 2, -2)])
    forward, backward, far_ahead, far_behind = np.split(loop.dynamics(time_s, perturbed, c).full(), 4, axis=1)
    jacobian = (8 * (forward - backward) - (far_ahead - far_behind)) / (12 * _INCREMENT)
    if not np.isfinite(jacobian).all():
        return np.full(x.size, np.nan)
    return np.asarray(np.linalg.eigvals(jacobian))


def _fastest(loop: ClosedLoop, values: Array) -> float:
    """Largest absolute pole at the start; NaN where there is none."""
    x0, c = loop.setup(values)
    return float(np.abs(find_poles(loop, 0.0, x0.full().ravel(), c.full().ravel())).max())
