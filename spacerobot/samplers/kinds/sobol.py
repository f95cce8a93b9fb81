"""Scrambled Sobol sequence."""

from __future__ import annotations

import warnings
from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered
from spacerobot.samplers.sampler import Sampler, SamplingPlan


@registered
class Sobol(Sampler):
    """Scrambled Sobol sequence, which covers the cube evenly."""

    name: ClassVar[str] = "sobol"
    place: ClassVar[float] = 3
    summary: ClassVar[str] = "scrambled"

    def points(self, plan: SamplingPlan) -> Array:
        """Points of SciPy's scrambled Sobol sequence (N, k)."""
        from scipy.stats import qmc

        rng = np.random.default_rng(plan.seed)
        with warnings.catch_warnings():
            # SciPy warns where N is not a power of two; the user chose that number
            warnings.simplefilter("ignore", UserWarning)
            return np.asarray(qmc.Sobol(len(plan.parameters), rng=rng).random(plan.samples))
