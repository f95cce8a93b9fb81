"""Most probable failures: the points of a limit state's surface that lie nearest to the origin.

The algorithm is the HLRF iteration of Hasofer, Lind, Rackwitz and Fiessler with the step length of Zhang and
Der Kiureghian (Lecture Notes in Engineering 61, 1995). From z it steps towards the point of the linearised
surface g + g' . (y - z) = 0 nearest to the origin,

    d = ((g' . z - g) / |g'|^2) g' - z,

and shortens the step until the merit |z|^2 / 2 + c |g| decreases. The starts of a round advance together, so
that their rollouts are vectorised.

A limit state may have several design points, of which each start finds one. Starts are drawn independently
until :data:`QUIET` of them in succession find nothing new. The mirror image of each design point is a start
too, since many systems fail alike in opposite directions.

The confidence that no design point is missing follows from the random starts that converge. Let p be the
probability that one of them converges to an undiscovered design point. If p > e, the probability that m of
them in succession find none is at most (1 - e)^m. With D design points there are D + 1 occasions for such a
sequence, so that with confidence 1 - a

    p <= 1 - (a / (D + 1))^(1 / m).

This bounds what further search would find, not the probability of failure in regions that no start reaches.
Such regions are left to the samples of the estimators (:mod:`optim.reliability.kinds.importance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optim.reliability.limit_state import MOST_SCORE, LimitState
from spacerobot.common.arrays import Array

ITERATIONS = 30
LENGTHS = 0.5 ** np.arange(6)  # of the step that are tried, all at once
LONGEST = 3.0  # of a step
TOLERANCE = 1e-3  # of the distance from the surface, and of the step
APART = 0.3  # nearer design points are the same
RADIUS = 5.0  # of the ball, in standard deviations, from which starts are drawn
ROUND = 16  # starts that move at once
QUIET = 48  # starts in succession without a new design point that end the search
MOST_STARTS = 256
CONFIDENCE = 0.95


@dataclass(frozen=True)
class DesignPoint:
    """A most probable failure.

    Attributes:
        z: Scores (k,), on the surface of the limit state.
        direction: Unit vector (k,) along which the limit state falls there.
    """

    z: Array
    direction: Array

    @property
    def beta(self) -> float:
        """Reliability index: distance from the origin, negative where the origin fails."""
        return float(self.z @ self.direction)


@dataclass(frozen=True)
class DesignPointSearch:
    """Design points of a limit state and the effort of their search.

    Attributes:
        points: Distinct design points, the most probable first.
        starts, converged: Starts that were drawn, and those of them that converged.
        quiet: Drawn starts that converged since one of them found a new design point.
    """

    points: tuple[DesignPoint, ...]
    starts: int
    converged: int
    quiet: int

    @property
    def undiscovered(self) -> float:
        """Upper 95 % confidence limit of the probability that another start finds a new design point."""
        if self.quiet == 0:
            return 1.0
        return float(1 - ((1 - CONFIDENCE) / (len(self.points) + 1)) ** (1 / self.quiet))


def search_design_points(state: LimitState, rng: np.random.Generator) -> DesignPointSearch:
    """Search for design points until several further starts find nothing new.

    Args:
        state: The limit state.
        rng: Generator of the starts.
    """
    k, points = len(state.names), list[DesignPoint]()
    starts = converged = quiet = 0
    # the origin is a good start of most systems, but a stationary point of symmetric ones
    extra = np.zeros((1, k))
    while quiet < QUIET and starts < MOST_STARTS:
        direction = rng.standard_normal((ROUND, k))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        starting_points = direction * rng.uniform(0, RADIUS, (ROUND, 1))
        ends = converge(state, np.vstack([starting_points, extra]), points)
        size = len(points)
        for number, end in enumerate(ends):
            if number < ROUND:
                starts += 1
            if end is None:
                continue
            is_new = add_distinct(points, end)
            if number < ROUND:
                converged += 1
                quiet = 0 if is_new else quiet + 1
        extra = np.array([-point.z for point in points[size:]]).reshape(-1, k)
        if not converged and starts >= 2 * ROUND:
            break
    return DesignPointSearch(tuple(sorted(points, key=lambda point: point.beta)), starts, converged, quiet)


def add_distinct(points: list[DesignPoint], point: DesignPoint) -> bool:
    """Append a design point unless it is in the list; whether it was new."""
    if any(np.linalg.norm(point.z - other.z) <= APART for other in points):
        return False
    points.append(point)
    return True


def converge(
    state: LimitState, starts: Array, others: Sequence[DesignPoint] = ()
) -> list[DesignPoint | None]:
    """Design point to which the iteration converges from each start.

    Args:
        state: The limit state.
        starts: Scores (S, k) to begin from.
        others: Design points at which the iteration ends as soon as it is nearer than :data:`APART`.

    Returns:
        list: Design point of each start; None where the iteration does not converge.
    """
    z = np.atleast_2d(starts).copy()
    ends: list[DesignPoint | None] = [None] * len(z)
    places = np.arange(len(z))
    for _ in range(ITERATIONS):
        for point in others:
            at = np.linalg.norm(z - point.z, axis=1) <= APART
            for place in places[at]:
                ends[place] = point
            z, places = z[~at], places[~at]
        if not len(z):
            break
        value, slope = state.gradients(z)
        size = np.linalg.norm(slope, axis=1)
        usable = np.isfinite(value) & np.isfinite(size) & (size > 0)
        z, value, slope, size, places = (each[usable] for each in (z, value, slope, size, places))
        if not len(z):
            break
        target = ((np.sum(slope * z, axis=1) - value) / size**2)[:, None] * slope
        reach = np.maximum(np.linalg.norm(z, axis=1), np.linalg.norm(target, axis=1))
        step = target - z
        length = np.linalg.norm(step, axis=1)
        near = (length <= TOLERANCE * (1 + np.linalg.norm(z, axis=1))) & (np.abs(value) <= TOLERANCE * size)
        outward = -slope / size[:, None]
        for place, end, direction in zip(places[near], z[near], outward[near], strict=True):
            ends[place] = DesignPoint(end, direction)
        each = (z, value, step, length, 2 * reach / size, places)
        z, value, step, length, penalty, places = (one[~near] for one in each)
        if not len(z):
            break
        accepted, z = _line_search(state, z, value, penalty, step * np.minimum(1, LONGEST / length)[:, None])
        places = places[accepted]
    return ends


def _line_search(
    state: LimitState, z: Array, value: Array, penalty: Array, step: Array
) -> tuple[NDArray[np.int64], Array]:
    """Rows for which the merit accepts a length of the step, and their points.

    The penalty c exceeds |z| / |g'| at both ends of the step, which therefore descends.
    """
    merit = 0.5 * np.sum(z**2, axis=1) + penalty * np.abs(value)
    slope = np.sum(z * step, axis=1) - penalty * np.abs(value)
    ends, rows = np.full_like(z, np.nan), np.arange(len(z))
    # most whole steps are accepted; where one is not, all shorter ones are tried at once
    for lengths in (LENGTHS[:1], LENGTHS[1:]):
        tried = np.clip(z[rows] + lengths[:, None, None] * step[rows], -MOST_SCORE, MOST_SCORE)
        values = state.values(tried.reshape(-1, z.shape[1])).reshape(len(lengths), -1)
        merits = 0.5 * np.sum(tried**2, axis=2) + penalty[rows] * np.abs(values)
        good = merits <= merit[rows] + 1e-4 * lengths[:, None] * slope[rows]
        first, has_good = np.argmax(good, axis=0), good.any(axis=0)
        ends[rows[has_good]] = tried[first[has_good], np.flatnonzero(has_good)]
        rows = rows[~has_good]
        if not len(rows):
            break
    accepted = np.setdiff1d(np.arange(len(z)), rows)
    return accepted, ends[accepted]
