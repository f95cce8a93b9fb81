"""Draws of a campaign: points of the unit cube, correlated and mapped to the parameters' distributions.

All samples are drawn at once from the seed, so that sample i does not depend on the order of evaluation.
"""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.special import ndtr, ndtri

from spacerobot.common.arrays import Array
from spacerobot.scenario import Campaign, UncertainParameter

INSIDE = 2.0**-53  # nearest that a coordinate may come to 0 or 1: distributions without bounds end there


def draw(campaign: Campaign) -> Array:
    """Values (N, k) of the uncertain parameters, in their order.

    Args:
        campaign: Distributions, design, number of samples and seed.

    Raises:
        SpaceRobotError: If the design needs a package that is not installed.
    """
    u = campaign.sampler.points(campaign)
    if not campaign.sampler.reaches_bounds:
        u = np.clip(u, INSIDE, 1 - INSIDE)
    if campaign.correlation is not None:
        # a Gaussian copula's dependence in place of none
        scores = ndtri(u) @ np.linalg.cholesky(np.array(campaign.correlation)).T
        u = np.clip(ndtr(scores), INSIDE, 1 - INSIDE)
    columns = [quantiles(p, column) for p, column in zip(campaign.parameters.values(), u.T, strict=True)]
    return np.ascontiguousarray(np.column_stack(columns))


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


def score_values(parameter: UncertainParameter, z: Array) -> tuple[Array, Array]:
    """Values x = F^-1(Phi(z)) (N,) of a distribution at standard normal scores z (N,), and dx/dz (N,)."""
    low, high = parameter.lower or 0.0, parameter.upper or 0.0
    mean, std = parameter.mean or 0.0, parameter.std or 1.0
    if parameter.kind == "uniform":
        return low + (high - low) * ndtr(z), (high - low) * stats.norm.pdf(z)
    if parameter.kind == "normal":
        return mean + std * z, np.full(len(z), std)
    if parameter.kind == "lognormal":
        value = (parameter.median or 1.0) * np.exp((parameter.sigma or 0.0) * z)
        return value, (parameter.sigma or 0.0) * value
    cut = stats.truncnorm((low - mean) / std, (high - mean) / std, loc=mean, scale=std)
    # the smaller tail probability has the smaller rounding error
    value = np.where(z < 0, cut.ppf(ndtr(z)), cut.isf(ndtr(-z)))
    return value, stats.norm.pdf(z) / cut.pdf(value)


def probabilities(parameter: UncertainParameter, values: Array) -> Array:
    """Probability (N,) that a distribution is below values (N,); the inverse of :func:`quantiles`."""
    low, high = parameter.lower or 0.0, parameter.upper or 0.0
    mean, std = parameter.mean or 0.0, parameter.std or 1.0
    if parameter.kind == "uniform":
        return np.clip((values - low) / (high - low), 0.0, 1.0)
    if parameter.kind == "normal":
        return np.asarray(ndtr((values - mean) / std))
    if parameter.kind == "lognormal":
        return np.asarray(ndtr(np.log(values / (parameter.median or 1.0)) / (parameter.sigma or 1.0)))
    return np.asarray(
        stats.truncnorm.cdf(values, (low - mean) / std, (high - mean) / std, loc=mean, scale=std)
    )
