"""Latin hypercube: each of N equal intervals of every coordinate has one point."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered
from spacerobot.samplers.sampler import Sampler, SamplingPlan


@registered
class LatinHypercube(Sampler):
    """Latin hypercube: each of N equal intervals of every coordinate has one point."""

    name: ClassVar[str] = "latin_hypercube"
    place: ClassVar[float] = 2
    summary: ClassVar[str] = "stratified in each parameter"

    def points(self, plan: SamplingPlan) -> Array:
        """Points of SciPy's Latin hypercube (N, k)."""
        from scipy.stats import qmc

        rng = np.random.default_rng(plan.seed)
        return np.asarray(qmc.LatinHypercube(len(plan.parameters), rng=rng).random(plan.samples))
