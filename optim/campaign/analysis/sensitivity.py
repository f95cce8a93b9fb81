"""Sensitivity analysis: uncertain parameters on which a metric depends, and the form of the dependence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from optim.campaign.analysis.statistics import rank_correlations, rank_noise, sobol_indices
from spacerobot.common.arrays import Array
from spacerobot.scenario import Campaign

WORTH_TELLING = 0.3  # size of a correlation between parameters from which their effects mix


def what_matters(draws: Array, values: Array, campaign: Campaign, *, complete: bool) -> dict[str, Any]:
    """Sensitivity of a metric to the parameters as plain data: Sobol' indices if the design allows, or ranks.

    ``strongest`` lists the significant parameters, largest effect first. ``how`` is ``rises`` or ``falls``
    (the metric with the parameter), ``away`` or ``middle`` (larger metric far from or near the parameter's
    middle), or ``share`` (total Sobol' index, a share of the variance).

    Args:
        draws: Values of k parameters (n, k).
        values: The metric (n,), infinite where a rollout was not completed or has no such value.
        campaign: Campaign section.
        complete: Whether every sample is among them.
    """
    names = list(campaign.parameters)
    plain = rank_correlations(draws, values)
    away = rank_correlations(np.abs(draws - np.median(draws, axis=0)), values)
    entry: dict[str, Any] = {
        "kind": "rank_correlation",
        "value": _named(names, plain),
        "away": _named(names, away),
    }
    noise = noise_of(len(draws), campaign)
    correlations = []
    for name, one, other in zip(names, np.nan_to_num(plain), np.nan_to_num(away), strict=True):
        value = float(one if abs(one) >= abs(other) else other)
        rising, falling = ("rises", "falls") if abs(one) >= abs(other) else ("away", "middle")
        if abs(value) > noise:
            correlations.append({"parameter": name, "how": rising if value > 0 else falling, "value": value})
    entry["strongest"] = sorted(correlations, key=lambda row: -abs(row["value"]))
    if np.ptp(np.nan_to_num(values, posinf=np.finfo(float).max)) == 0:
        entry["note"] = "no rollout has a value" if np.isinf(values).all() else "it does not vary"
    elif campaign.sampler.gives_sobol_indices:
        lost = int((~np.isfinite(values)).sum())
        if lost or not complete:
            why = f"{lost} rollouts have no value" if lost else "not every sample is there yet"
            entry["note"] = f"{why}: Sobol' indices need them all"
        elif (indices := sobol_indices(values, names, campaign.confidence)) is not None:
            keys = ("first", "first_width", "total", "total_width")
            clear = zip(names, indices.total, indices.total_width, strict=True)
            rows = [{"parameter": n, "how": "share", "value": float(t)} for n, t, width in clear if t > width]
            entry |= {"kind": "sobol", **{key: _named(names, getattr(indices, key)) for key in keys}}
            entry["strongest"] = sorted(rows, key=lambda row: -row["value"])
    return entry


def noise_of(count: int, campaign: Campaign) -> float:
    """Size that no rank correlation exceeds by chance, at the campaign's confidence for all of them."""
    tries = 2 * len(campaign.parameters)
    return rank_noise(count, 1 - (1 - campaign.confidence) / tries)


def correlated(campaign: Campaign) -> list[dict[str, Any]]:
    """Pairs of parameters that are drawn with a notable correlation."""
    names, rows = list(campaign.parameters), campaign.correlation or ()
    return [
        {"first": names[j], "second": names[i], "value": rows[i][j]}
        for i in range(len(rows))
        for j in range(i)
        if abs(rows[i][j]) >= WORTH_TELLING
    ]


def _named(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {n: float(v) if np.isfinite(v) else None for n, v in zip(names, values, strict=True)}
