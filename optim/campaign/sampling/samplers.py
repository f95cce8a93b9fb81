"""Draws of a campaign: points of the unit cube, correlated, then carried into the distributions.

All samples are drawn at once from the seed, so that sample i is the same however they are worked through.
"""

from __future__ import annotations

import importlib
import itertools
import warnings
from typing import Any

import numpy as np
from scipy import stats
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from spacerobot.scenario import Campaign, UncertainParameter

INSIDE = 2.0**-53  # nearest that a coordinate may come to 0 or 1: distributions without bounds end there


def draw(campaign: Campaign) -> Array:
    """Values (N, k) of the uncertain parameters, in their order.

    Parameters
    ----------
    campaign
        Distributions, design, number of samples and seed.

    Raises
    ------
    SpaceRobotError
        If the design needs SALib, and it is not installed.
    """
    u = unit_points(campaign)
    if campaign.design != "grid":
        u = np.clip(u, INSIDE, 1 - INSIDE)
    if campaign.correlation is not None:
        u = correlate(u, np.array(campaign.correlation))
    columns = [quantiles(p, column) for p, column in zip(campaign.parameters.values(), u.T, strict=True)]
    return np.ascontiguousarray(np.column_stack(columns))


def unit_points(campaign: Campaign) -> Array:
    """The design in the unit cube (N, k), independent coordinates."""
    k, n = len(campaign.parameters), campaign.samples
    rng = np.random.default_rng(campaign.seed)
    if campaign.design == "grid":
        return _grid(campaign)
    if campaign.design == "monte_carlo":
        return np.asarray(rng.random((n, k)))
    if campaign.design == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(k, rng=rng).random(n))
    if campaign.design == "saltelli":
        sample = salib("sample.sobol").sample
        problem = salib_problem(campaign)
        return np.asarray(sample(problem, n, calc_second_order=False, seed=campaign.seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a number that is no power of two is the user's choice
        return np.asarray(qmc.Sobol(k, rng=rng).random(n))


def correlate(u: Array, correlation: Array) -> Array:
    """Points (N, k) of the unit cube with a Gaussian copula's dependence in place of none.

    Parameters
    ----------
    u
        Independent points, strictly inside.
    correlation
        Of the normal scores (k, k).
    """
    z = ndtri(u) @ np.linalg.cholesky(correlation).T
    return np.asarray(np.clip(ndtr(z), INSIDE, 1 - INSIDE))


def quantiles(parameter: UncertainParameter, u: Array) -> Array:
    """Values (N,) of a distribution at probabilities u (N,)."""
    low, high = parameter.lower or 0.0, parameter.upper or 0.0
    mean, std = parameter.mean or 0.0, parameter.std or 1.0
    if parameter.kind == "uniform":
        return np.asarray(low + (high - low) * u)
    if parameter.kind == "normal":
        return np.asarray(mean + std * ndtri(u))
    if parameter.kind == "lognormal":
        return np.asarray((parameter.median or 1.0) * np.exp((parameter.sigma or 0.0) * ndtri(u)))
    cut = stats.truncnorm.ppf(u, (low - mean) / std, (high - mean) / std, loc=mean, scale=std)
    return np.asarray(np.clip(cut, low, high))


def salib_problem(campaign: Campaign) -> dict[str, Any]:
    """The unit cube as SALib describes it."""
    names = list(campaign.parameters)
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}


def salib(module: str) -> Any:
    """A module of SALib, which is optional.

    Raises
    ------
    SpaceRobotError
        If it is not installed.
    """
    try:
        return importlib.import_module(f"SALib.{module}")
    except ImportError:
        raise SpaceRobotError(
            "the design saltelli needs SALib: pip install SALib", where="campaign"
        ) from None


def _grid(campaign: Campaign) -> Array:
    """Every combination of levels; the ends of a distribution belong to it where it has ends."""
    axes = []
    for parameter in campaign.parameters.values():
        count = parameter.levels or campaign.levels
        bounded = parameter.lower is not None and count > 1
        steps = np.arange(count)
        axes.append(steps / (count - 1) if bounded else (steps + 0.5) / count)
    return np.array(list(itertools.product(*axes)), dtype=float)
