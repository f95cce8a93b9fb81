"""Saltelli's design for Sobol' indices, by SALib."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.optional import optional_module
from spacerobot.common.registry import registered
from spacerobot.samplers.sampler import Sampler, SamplingPlan


@registered
class Saltelli(Sampler):
    """Saltelli's design for Sobol' indices, by SALib."""

    name: ClassVar[str] = "saltelli"
    place: ClassVar[float] = 5
    summary: ClassVar[str] = "for Sobol' indices; needs SALib"
    takes_correlation: ClassVar[bool] = False
    has_intervals: ClassVar[bool] = False
    gives_sobol_indices: ClassVar[bool] = True
    has_any_size: ClassVar[bool] = False

    def count(self, plan: SamplingPlan) -> int:
        """Number of points N (k + 2), with N base samples and k parameters."""
        return plan.samples * (len(plan.parameters) + 2)

    def check(self, plan: SamplingPlan) -> None:
        """Check that the number of base samples is a power of two."""
        if plan.samples & (plan.samples - 1):
            raise ValueError(f"samples: a power of two for the design saltelli, found {plan.samples}")

    def points(self, plan: SamplingPlan) -> Array:
        """Points of SALib's Saltelli design (N (k + 2), k)."""
        names = list(plan.parameters)
        problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
        sample = optional_module("SALib.sample.sobol", "sobol", f"the design {self.name}").sample
        return np.asarray(sample(problem, plan.samples, calc_second_order=False, seed=plan.seed))
