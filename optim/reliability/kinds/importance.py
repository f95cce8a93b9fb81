"""Importance sampling about the design points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from optim.reliability.design_points import DesignPoint
from optim.reliability.estimator import ProbabilityEstimate, ProbabilityEstimator, SamplingEffort, mean_of
from optim.reliability.limit_state import LimitState
from spacerobot.registry import registered

BLOCK = 500  # rollouts after which the accuracy is judged
LEAST = 1000
NOMINAL = 0.1
"""Share of the samples that is drawn from the standard normal distribution itself: no weight exceeds its
inverse, so a failure far from all design points cannot spoil the estimate unseen (Hesterberg, Technometrics
37(2), 1995)."""


@registered
class ImportanceSampling(ProbabilityEstimator):
    """Samples about all design points, weighted by the ratio of the densities; unbiased."""

    name: ClassVar[str] = "importance"
    title: ClassVar[str] = "importance sampling about the design points"
    place: ClassVar[float] = 1

    def estimate(
        self, state: LimitState, points: Sequence[DesignPoint], effort: SamplingEffort
    ) -> ProbabilityEstimate:
        """Mean of the weights of the samples that fail; see :meth:`ProbabilityEstimator.estimate`."""
        rng, k = effort.rng, len(state.names)
        centres = np.array([np.zeros(k), *(point.z for point in points)])
        near = stats.norm.sf([point.beta for point in points])
        shares = np.array([NOMINAL, *((1 - NOMINAL) * near / near.sum())]) if len(points) else np.ones(1)
        weights = np.empty(0)
        while len(weights) + BLOCK <= effort.budget:
            z = centres[rng.choice(len(centres), BLOCK, p=shares)] + rng.standard_normal((BLOCK, k))
            # log of phi(z) over the mixture's density
            logs = z @ centres.T - 0.5 * np.sum(centres**2, axis=1)
            weight = np.exp(-logsumexp(logs, axis=1, b=shares))
            weights = np.append(weights, weight * (state.values(z) < 0))
            if len(weights) >= LEAST and mean_of(weights).variation <= effort.variation:
                break
        return mean_of(weights)
