"""Data profiles: which share of all problems, targets and runs a method solved within a budget.

J. J. More, S. M. Wild, "Benchmarking derivative-free optimization algorithms", SIAM J. Optim. 20(1), 2009.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optim.comparison.running_time import LEVEL, RESAMPLES, SEED
from spacerobot.common.arrays import Array

BUDGETS = 60  # for which a profile is computed, evenly over the decades


@dataclass(frozen=True)
class DataProfile:
    """Share solved over budget.

    Attributes:
        budgets: Costs at which the profile is evaluated (n,) [rollouts].
        share, low, high: Solved within each budget, and the bootstrap interval of it, over problems and runs,
            each (n,).
    """

    budgets: Array
    share: Array
    low: Array
    high: Array


def budgets_of(hits: Mapping[str, Sequence[Array]]) -> Array:
    """Budgets (n,) in equal ratios, from half the smallest to the largest cost of a met target."""
    every = np.concatenate([np.ravel(table) for tables in hits.values() for table in tables] or [np.ones(1)])
    solved = every[np.isfinite(every)]
    if not len(solved):
        solved = np.ones(1)
    return np.geomspace(max(1.0, solved.min() / 2), max(2.0, solved.max()), BUDGETS)


def profile(hits: Sequence[Array], budgets: Array) -> DataProfile:
    """Data profile of one method.

    Problems have equal weights, and so have the targets and runs of each. The bootstrap draws problems, and
    runs within each drawn problem.

    Args:
        hits: Cost at which each run met each target, (runs, targets) for each problem; infinite where it did
            not.
        budgets: Costs at which the profile is evaluated (n,) [rollouts].
    """
    # share of the targets that run i of problem c solved within budget b
    solved = [(table[:, :, None] <= budgets).mean(axis=1) for table in hits]
    share = np.mean([table.mean(axis=0) for table in solved], axis=0)
    rng = np.random.default_rng(SEED)
    again = np.empty((RESAMPLES, len(budgets)))
    for i in range(RESAMPLES):
        resampled = [solved[c] for c in rng.integers(len(solved), size=len(solved))]
        again[i] = np.mean([t[rng.integers(len(t), size=len(t))].mean(axis=0) for t in resampled], axis=0)
    low, high = np.quantile(again, ((1 - LEVEL) / 2, (1 + LEVEL) / 2), axis=0)
    return DataProfile(budgets, share, low, high)
