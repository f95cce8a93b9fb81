"""Expected running time and success rate of a method, from independent runs; each run counts for itself.

N. Hansen, A. Auger, R. Ros, O. Mersmann, T. Tusar, D. Brockhoff, "COCO: a platform for comparing continuous
optimizers in a black-box setting", 2021: the expected running time (ERT) to a target is what all runs spent
until they met it, or until they ended, over the number of runs that met it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from optim.comparison.cost_unit import CostUnit
from optim.problem.problem import EvaluationCost
from optim.search.search import SearchRun
from spacerobot.common.arrays import Array

PRECISIONS = (0.1, 0.01, 0.001)  # targets: relative distance from the best known value
RESAMPLES = 1000
LEVEL = 0.9  # of every interval
SEED = 0  # of every bootstrap


@dataclass(frozen=True)
class MethodRun:
    """One independent run of a method.

    Attributes:
        costs, objectives: Cost so far [rollouts] and best feasible objective so far at each improvement, each
            (n,).
        spent: Total cost [rollouts].
    """

    costs: Array
    objectives: Array
    spent: float

    def hit(self, target: float) -> float:
        """Cost at which the run met the target; infinite if it did not."""
        met = np.flatnonzero(self.objectives <= target)
        return float(self.costs[met[0]]) if len(met) else float("inf")


@dataclass(frozen=True)
class RunningTime:
    """Cost at which a method reaches a target.

    Attributes:
        expected, low, high: Expected running time in rollouts and its bootstrap interval; infinite where no
            run met the target.
        met, runs: Number of runs that met the target, and of all runs.
        rate_low, rate_high: Wilson's interval of the success rate.
        until_met: Mean cost at which the successful runs met the target; NaN without any.
        until_end: Mean cost of the other runs up to their end; NaN without any.
    """

    expected: float
    low: float
    high: float
    met: int
    runs: int
    rate_low: float
    rate_high: float
    until_met: float
    until_end: float


def trial_of(run: SearchRun, cost_unit: CostUnit, before: EvaluationCost | None = None) -> MethodRun:
    """Costs in rollouts and objectives at which a run improved.

    Args:
        run: The run.
        cost_unit: Cost of the evaluations in rollouts.
        before: Cost of the runs that the method builds on, which is added; none if None.
    """
    before = before or EvaluationCost()
    costs, objectives = list[float](), list[float]()
    for moment in run.history:
        if np.isfinite(moment.objective) and (not objectives or moment.objective < objectives[-1]):
            costs.append(cost_unit.rollouts(before + moment.cost))
            objectives.append(moment.objective)
    return MethodRun(np.array(costs), np.array(objectives), cost_unit.rollouts(before + run.cost))


def target_of(best: float, precision: float) -> float:
    """The objective that lies a given fraction above the best known one."""
    return best + precision * abs(best)


def running_time(trials: Sequence[MethodRun], target: float) -> RunningTime:
    """Expected running time to a target and success rate, with intervals.

    Args:
        trials: Independent runs of one method, at least one.
        target: Objective to reach.
    """
    from scipy.stats import binomtest

    hits = np.array([trial.hit(target) for trial in trials])
    met = np.isfinite(hits)
    costs = np.where(met, hits, [trial.spent for trial in trials])
    resampled = np.random.default_rng(SEED).integers(len(trials), size=(RESAMPLES, len(trials)))
    again = _ratio(costs[resampled].sum(axis=1), met[resampled].sum(axis=1))
    low, high = np.quantile(again, ((1 - LEVEL) / 2, (1 + LEVEL) / 2), method="inverted_cdf")
    rate = binomtest(int(met.sum()), len(trials)).proportion_ci(LEVEL, method="wilson")
    return RunningTime(
        float(_ratio(costs.sum(), met.sum())),
        float(low),
        float(high),
        int(met.sum()),
        len(trials),
        float(rate.low),
        float(rate.high),
        float(costs[met].mean()) if met.any() else float("nan"),
        float(costs[~met].mean()) if not met.all() else float("nan"),
    )


def _ratio(cost: npt.ArrayLike, met: npt.ArrayLike) -> Array:
    """Cost divided by the number of successes; infinite without a success."""
    cost, met = np.asarray(cost, dtype=float), np.asarray(met, dtype=float)
    ratio = np.full(cost.shape, np.inf)
    np.divide(cost, met, out=ratio, where=met > 0)
    return ratio
