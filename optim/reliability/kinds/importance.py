"""Importance sampling about the design points.

Samples are drawn from a mixture of normal distributions: one about each design point, in proportion to
Phi(-beta), the standard normal distribution itself, and a wide one about the origin, N(0, (1 + beta^2 / k)),
whose samples are about as far away as the nearest failure but in all directions. The last two are defensive:
weights stay bounded, and a region of failure that the search missed is hit. Failures outside the half-spaces
of all design points are starts of the search for further ones. If that finds one, sampling begins again with
it: the estimate is the mean of samples of one mixture, which depends on earlier samples alone, and therefore
unbiased.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from optim.reliability.design_points import DesignPoint, add_distinct, converge
from optim.reliability.estimator import ProbabilityEstimate, ProbabilityEstimator, SamplingEffort, mean_of
from optim.reliability.limit_state import LimitState
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered

BLOCK = 500  # rollouts after which the accuracy is judged
LEAST = 1000
NOMINAL = 0.1
"""Share of the samples that is drawn from the standard normal distribution itself: no weight exceeds its
inverse, so a failure far from all design points cannot spoil the estimate unseen (Hesterberg, Technometrics
37(2), 1995)."""
WIDE = 0.1
"""Share of the samples that is drawn from the wide distribution."""
CURIOSITY = 8
"""Failures outside the half-spaces that are starts after each block."""
FUTILE = 2
"""Blocks after which the search ends, if their failures lead to no new design point."""


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
        rng, k, regions = effort.rng, len(state.names), list(points)
        weights, left, futile = np.empty(0), effort.budget, 0
        while left >= BLOCK:
            left -= BLOCK
            mixture = _Mixture(regions, k)
            z = mixture.draw(rng, BLOCK)
            failed = state.values(z) < 0
            weights = np.append(weights, mixture.weights(z) * failed)
            outside = failed & np.all([z @ one.direction < one.beta for one in regions], axis=0)
            if futile < FUTILE and outside.any() and left >= LEAST:
                ends = converge(state, z[outside][:CURIOSITY], regions)
                is_new = [add_distinct(regions, end) for end in ends if end is not None]
                if any(is_new):
                    weights, futile = np.empty(0), 0
                    continue
                futile += 1
            if len(weights) >= LEAST and mean_of(weights).variation <= effort.variation:
                break
        largest = float(weights.max() / weights.sum()) if weights.any() else 0.0
        return replace(mean_of(weights), largest=largest, points=tuple(regions[len(points) :]))


class _Mixture:
    """Normal distributions about the design points, the standard one and a wide one."""

    def __init__(self, points: Sequence[DesignPoint], k: int) -> None:
        self.centres = np.array([np.zeros(k), np.zeros(k), *(point.z for point in points)])
        self.deviations = np.ones(len(self.centres))
        self.shares = np.array([1.0, 0.0])
        if points:
            nearest = min(point.beta for point in points)
            self.deviations[1] = np.sqrt(1 + nearest**2 / k)
            near = stats.norm.sf([point.beta for point in points])
            self.shares = np.array([NOMINAL, WIDE, *((1 - NOMINAL - WIDE) * near / near.sum())])

    def draw(self, rng: np.random.Generator, size: int) -> Array:
        """Samples (size, k)."""
        which = rng.choice(len(self.centres), size, p=self.shares)
        return self.centres[which] + self.deviations[which, None] * rng.standard_normal(
            (size, self.centres.shape[1])
        )

    def weights(self, z: Array) -> Array:
        """Ratio (n,) of the standard normal density to the mixture's at samples (n, k)."""
        scaled = (z[:, None] - self.centres) / self.deviations[:, None]
        logs = 0.5 * (np.sum(z**2, axis=1)[:, None] - np.sum(scaled**2, axis=2))
        shares = self.shares / self.deviations ** z.shape[1]
        return np.asarray(np.exp(-logsumexp(logs, axis=1, b=shares)))
