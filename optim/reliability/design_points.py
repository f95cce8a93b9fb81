"""Most probable failures: the points of a limit state's surface that lie nearest to the origin.

The iteration of Hasofer, Lind, Rackwitz and Fiessler with the step length of Zhang and Der Kiureghian
(Lecture Notes in Engineering 61, 1995): from z towards the nearest point of the linearised surface,

    d = ((g' . z - g) / |g'|^2) g' - z,

as far as the merit |z|^2 / 2 + c |g| falls. All starts move at once, so that their rollouts fill the lanes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optim.reliability.limit_state import MOST_SCORE, LimitState
from spacerobot.arrays import Array

ITERATIONS = 30
LENGTHS = 0.5 ** np.arange(6)  # of the step that are tried, all at once
LONGEST = 3.0  # of a step
TOLERANCE = 1e-3  # of the distance from the surface, and of the step
APART = 0.3  # nearer design points are the same


@dataclass(frozen=True)
class DesignPoint:
    """A most probable failure.

    Attributes
    ----------
    z
        Scores (k,), on the surface of the limit state.
    direction
        Unit vector (k,) along which the limit state falls there.
    """

    z: Array
    direction: Array

    @property
    def beta(self) -> float:
        """Reliability index: distance from the origin, negative where the origin fails."""
        return float(self.z @ self.direction)


def find_design_points(state: LimitState, starts: Array) -> list[DesignPoint]:
    """Design points of a limit state, the most probable first.

    Parameters
    ----------
    state
        The limit state.
    starts
        Scores (S, k) to begin from.

    Returns
    -------
    list
        Distinct points at which the iteration converged; empty if it never did.
    """
    z = np.atleast_2d(starts).copy()
    found: list[DesignPoint] = []
    for _ in range(ITERATIONS):
        value, slope = state.gradients(z)
        size = np.linalg.norm(slope, axis=1)
        usable = np.isfinite(value) & np.isfinite(size) & (size > 0)
        z, value, slope, size = z[usable], value[usable], slope[usable], size[usable]
        if not len(z):
            break
        target = ((np.sum(slope * z, axis=1) - value) / size**2)[:, None] * slope
        reach = np.maximum(np.linalg.norm(z, axis=1), np.linalg.norm(target, axis=1))
        step = target - z
        length = np.linalg.norm(step, axis=1)
        near = (length <= TOLERANCE * (1 + np.linalg.norm(z, axis=1))) & (np.abs(value) <= TOLERANCE * size)
        outward = -slope / size[:, None]
        found += [DesignPoint(*pair) for pair in zip(z[near], outward[near], strict=True)]
        z, value, step, length, penalty = (each[~near] for each in (z, value, step, length, 2 * reach / size))
        if not len(z):
            break
        z = _line_search(state, z, value, penalty, step * np.minimum(1, LONGEST / length)[:, None])
    found.sort(key=lambda point: point.beta)
    distinct: list[DesignPoint] = []
    for point in found:
        if all(np.linalg.norm(point.z - other.z) > APART for other in distinct):
            distinct.append(point)
    return distinct


def _line_search(state: LimitState, z: Array, value: Array, penalty: Array, step: Array) -> Array:
    """Points that the merit accepts; those of which it accepts none are dropped.

    The penalty c exceeds |z| / |g'| at both ends of the step, which therefore descends.
    """
    merit = 0.5 * np.sum(z**2, axis=1) + penalty * np.abs(value)
    slope = np.sum(z * step, axis=1) - penalty * np.abs(value)
    tried = np.clip(z + LENGTHS[:, None, None] * step, -MOST_SCORE, MOST_SCORE)
    values = state.values(tried.reshape(-1, z.shape[1])).reshape(len(LENGTHS), -1)
    merits = 0.5 * np.sum(tried**2, axis=2) + penalty * np.abs(values)
    good = merits <= merit + 1e-4 * LENGTHS[:, None] * slope
    first = np.argmax(good, axis=0)
    kept = np.flatnonzero(good.any(axis=0))
    chosen: Array = tried[first[kept], kept]
    return chosen
