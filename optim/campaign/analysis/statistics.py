"""Estimates with their intervals: percentiles, shares, differences, rank correlations, Sobol' indices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from spacerobot.common.arrays import Array
from spacerobot.common.optional import optional_module


@dataclass(frozen=True)
class Estimate:
    """A number and the interval that holds the true one with some confidence.

    Attributes:
        value: The estimate.
        low, high: The interval; an end is None where the samples do not bound it.
    """

    value: float
    low: float | None
    high: float | None


def percentile(values: Array, percent: float, confidence: float) -> Estimate:
    """Percentile of independent samples, with an interval from order statistics.

    The interval holds for any distribution: the number of samples below the true percentile is binomial. An
    end that would lie beyond the samples is None.

    Args:
        values: Samples (n,); infinite ones are greater than any other.
        percent: Between 0 and 100.
        confidence: Minimum confidence of the interval.
    """
    ordered, share = np.sort(values), percent / 100
    n = len(ordered)
    below = stats.binom(n, share)
    low = int(below.ppf((1 - confidence) / 2))  # P(count < low) <= (1 - confidence) / 2
    high = int(below.ppf((1 + confidence) / 2)) + 1
    # linear interpolation of order statistics that may be infinite
    at = round(share * (n - 1), 9)  # 0.07 * 100 is a little more than 7
    first = int(np.floor(at))
    a, b = ordered[first], ordered[min(first + 1, n - 1)]
    if at > first:
        a = a + (at - first) * (b - a) if np.isfinite(b) else b
    return Estimate(
        float(a),
        float(ordered[low - 1]) if low >= 1 else None,
        float(ordered[high - 1]) if high <= n else None,
    )


def share(hits: int, count: int, confidence: float) -> Estimate:
    """Estimate of an event's probability, with the interval of Clopper and Pearson.

    Args:
        hits, count: Number of samples in which the event occurred, and of all samples.
        confidence: Confidence level of the interval, between 0 and 1.

    Returns:
        Estimate: Probability with the ends of its interval.
    """
    interval = stats.binomtest(hits, count).proportion_ci(confidence, method="exact")
    return Estimate(hits / count, float(interval.low), float(interval.high))


def rank_correlations(draws: Array, values: Array) -> Array:
    """Spearman's rank correlation of each parameter with a metric (k,); NaN where either does not vary.

    Args:
        draws: Values of k parameters (n, k).
        values: The metric (n,); infinite ones have the highest rank.
    """
    ranks = np.column_stack([stats.rankdata(column) for column in (*draws.T, values)])
    ranks = ranks - ranks.mean(axis=0)
    size = np.sqrt((ranks**2).sum(axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        coefficients = ranks[:, :-1].T @ ranks[:, -1] / (size[:-1] * size[-1])
    return np.asarray(np.where((size[:-1] > 0) & (size[-1] > 0), coefficients, np.nan))


def rank_noise(count: int, confidence: float) -> float:
    """Size below which the rank correlation of two independent quantities stays."""
    return float(stats.norm.ppf((1 + confidence) / 2) / np.sqrt(max(count - 1, 1)))


@dataclass(frozen=True)
class Indices:
    """Sobol' indices of k parameters, each with the half-width of its interval, all (k,).

    Attributes:
        first, first_width: First-order index, the share of the variance that x_i explains without
            interactions, Var(E[y | x_i]) / Var(y).
        total, total_width: Total index, the share that remains if all other parameters are fixed,
            E[Var(y | x_~i)] / Var(y).
    """

    first: Array
    first_width: Array
    total: Array
    total_width: Array


def sobol_indices(values: Array, names: Sequence[str], confidence: float, seed: int = 0) -> Indices | None:
    """Sobol' indices, by SALib, of a metric over the design ``saltelli``; None if it does not vary.

    Args:
        values: The metric at all samples of the design, in order (n,), finite.
        names: Names of the k parameters.
        confidence, seed: Confidence of the intervals, and seed of their bootstrap.

    Raises:
        SpaceRobotError: If SALib is not installed.
    """
    if np.ptp(values) == 0:
        return None
    problem: dict[str, Any] = {
        "num_vars": len(names),
        "names": list(names),
        "bounds": [[0.0, 1.0]] * len(names),
    }
    analyze = optional_module("SALib.analyze.sobol", "sobol", "the analysis of the design saltelli").analyze
    indices = analyze(problem, values, calc_second_order=False, conf_level=confidence, seed=seed)
    return Indices(*(np.asarray(indices[key], dtype=float) for key in ("S1", "S1_conf", "ST", "ST_conf")))
