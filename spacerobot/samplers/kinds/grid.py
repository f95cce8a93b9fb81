"""Grid: every combination of levels."""

from __future__ import annotations

import itertools
import math
from typing import ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered
from spacerobot.samplers.sampler import Sampler, SamplingPlan


@registered
class Grid(Sampler):
    """Every combination of levels; those of a bounded distribution include its bounds."""

    name: ClassVar[str] = "grid"
    place: ClassVar[float] = 4
    summary: ClassVar[str] = "every combination of levels"
    takes_correlation: ClassVar[bool] = False
    has_intervals: ClassVar[bool] = False
    reaches_bounds: ClassVar[bool] = True
    is_factorial: ClassVar[bool] = True
    has_any_size: ClassVar[bool] = False

    def count(self, plan: SamplingPlan) -> int:
        """Product of the numbers of levels."""
        return math.prod(p.levels or plan.levels for p in plan.parameters.values())

    def points(self, plan: SamplingPlan) -> Array:
        """Points of the grid (N, k); the last parameter varies fastest."""
        axes = []
        for parameter in plan.parameters.values():
            count = parameter.levels or plan.levels
            bounded = parameter.lower is not None and count > 1
            steps = np.arange(count)
            axes.append(steps / (count - 1) if bounded else (steps + 0.5) / count)
        return np.array(list(itertools.product(*axes)), dtype=float)
