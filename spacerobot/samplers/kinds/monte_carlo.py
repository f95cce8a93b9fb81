"""Independent random points."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered
from spacerobot.samplers.sampler import Sampler, SamplingPlan


@registered
class MonteCarlo(Sampler):
    """Independent random points."""

    name: ClassVar[str] = "monte_carlo"
    place: ClassVar[float] = 1
    summary: ClassVar[str] = "independent"

    def points(self, plan: SamplingPlan) -> Array:
        """Uniform random numbers (N, k)."""
        return np.asarray(np.random.default_rng(plan.seed).random((plan.samples, len(plan.parameters))))
