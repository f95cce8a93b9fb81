"""Line sampling along the direction of the most probable failure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy import stats
from scipy.optimize import elementwise

from optim.reliability.design_points import DesignPoint
from optim.reliability.estimator import ProbabilityEstimate, ProbabilityEstimator, SamplingEffort, mean_of
from optim.reliability.limit_state import MOST_SCORE, LimitState
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered

BLOCK = 32  # lines that are searched at once
LEAST = 64
ROLLOUTS = 16  # of a line at most, about


@registered
class LineSampling(ProbabilityEstimator):
    """Line sampling: distance to failure along parallel lines.

    See Koutsourelakis, Pradlwarter and Schueller (Probabilistic Engineering Mechanics 19, 2004).

    Each line is taken to cross the surface of failure once: of several regions of failure it sees one.
    """

    name: ClassVar[str] = "line"
    title: ClassVar[str] = "line sampling"
    place: ClassVar[float] = 2

    def estimate(
        self, state: LimitState, points: Sequence[DesignPoint], effort: SamplingEffort
    ) -> ProbabilityEstimate:
        """Mean of the probabilities of the lines; see :meth:`ProbabilityEstimator.estimate`."""
        if not points:
            return ProbabilityEstimate(0.0, np.inf)
        # With z = y + t a, a the unit direction and y normal to it, t is standard normal, independent
        # of y. If a line fails beyond the distance t*(y), P(g < 0) = E[Phi(-t*(y))], estimated by a mean.
        rng, along = effort.rng, points[0].direction
        line_probabilities = np.empty(0)
        while (len(line_probabilities) + BLOCK) * ROLLOUTS <= effort.budget:
            z = rng.standard_normal((BLOCK, len(along)))
            z -= np.outer(z @ along, along)
            line_probabilities = np.append(
                line_probabilities, stats.norm.sf(_distances(state, z, along, points[0].beta))
            )
            if len(line_probabilities) >= LEAST and mean_of(line_probabilities).variation <= effort.variation:
                break
        return mean_of(line_probabilities) if len(line_probabilities) else ProbabilityEstimate(0.0, np.inf)

    def missing_share(self, points: Sequence[DesignPoint]) -> float:
        """First-order share of all failure regions except the most probable one; opposite ones count too."""
        shares = stats.norm.sf([point.beta for point in points])
        return float(1 - shares[0] / shares.sum()) if len(points) else 0.0


def _distances(state: LimitState, z: Array, along: Array, beta: float) -> Array:
    """Distances (n,) along the lines at which they fail; infinite where a line never does."""

    def value(distance: Array, index: Array) -> Array:
        state_values = state.values(z[index.astype(int)] + np.multiply.outer(distance, along))
        return np.maximum(state_values, -np.finfo(float).max)

    lines = np.arange(float(len(z)))
    ends = np.full(len(z), MOST_SCORE)
    failing = value(ends, lines) < 0
    begins = np.full(len(z), -MOST_SCORE)
    for begin in (0.0, min(beta, MOST_SCORE - 1)):
        begins = np.where(value(np.full(len(z), begin), lines) >= 0, begin, begins)
    distance = np.full(len(z), np.inf)
    if failing.any():
        solved = elementwise.find_root(
            value,
            (begins[failing], ends[failing]),
            args=(lines[failing],),
            tolerances={"xatol": 1e-3, "fatol": 0},
        )
        # a line that fails at both ends fails throughout
        distance[failing] = np.where(solved.success, solved.x, -MOST_SCORE)
    return distance
