"""Summary of a campaign: plain data for ``summary.json``, computed from its store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from optim.campaign.analysis.samples import command_of
from optim.campaign.analysis.sensitivity import correlated, noise_of, what_matters
from optim.campaign.analysis.statistics import Estimate, percentile, share
from optim.campaign.rollouts.evaluator import CampaignEvaluator
from optim.campaign.rollouts.metrics import CAPTURED, PLANS, SOLVE_TIMES
from optim.campaign.rollouts.trust import caveats, untrusted
from optim.campaign.sampling.parameter_space import sensor_offsets, units_of
from optim.campaign.store.folder import load_head
from optim.campaign.store.netcdf import load_campaign
from optim.campaign.store.run_settings import ScenarioSource, named_in
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, write_text
from spacerobot.quantities import find_quantity
from spacerobot.rollout import unclosed
from spacerobot.scenario import Campaign

SUMMARY = "summary.json"
MISSED = "missed"
"""Cause of failure of a sample that never captures a grasp which begins open."""
WORST = 5  # samples that are told of each set of gains


@dataclass(frozen=True)
class SampleStatistics:
    """Statistics of the samples of one set of gains.

    Attributes:
        metrics: Values (n, places) by name; infinite where a rollout was not completed or has no such value,
            such as the time of a capture that was missed.
        places, units: Label of each column of a metric, and unit of each metric.
        failed: Mask of the samples that failed (n,), by cause.
        unclosed: Grasp of each sample that did not close at the start, in words (n of them); empty where all
            did.
        missed: Whether each sample left a grasp that begins open uncaptured, or was not completed (n,); None
            where no grasp begins open.
    """

    metrics: Mapping[str, Array]
    places: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str]
    failed: Mapping[str, np.typing.NDArray[np.bool_]]
    unclosed: tuple[str, ...]
    missed: np.typing.NDArray[np.bool_] | None

    def largest(self, metric: str) -> Array:
        """Maximum over the columns of a metric (n,)."""
        return np.asarray(self.metrics[metric].max(axis=1))

    def badness(self, campaign: Campaign) -> tuple[list[str], Array]:
        """Name of each sample's worst metric, and its value (n,) as a share of its limit.

        Without limits it is the first recorded metric and its value.
        """
        limited = {name: most for name, most in campaign.limits.given.items() if name in self.metrics}
        limited = limited or {next(iter(self.metrics)): 1.0}
        ratios = np.array([self.largest(metric) / most for metric, most in limited.items()])
        names = list(limited)
        return [names[i] for i in ratios.argmax(axis=0)], np.asarray(ratios.max(axis=0))

    @property
    def any_failure(self) -> np.typing.NDArray[np.bool_]:
        """Whether each sample failed for any cause (n,)."""
        return np.asarray(np.logical_or.reduce(list(self.failed.values())), dtype=np.bool_)


def sample_statistics(data: xr.Dataset, evaluator: CampaignEvaluator) -> dict[str, SampleStatistics]:
    """Numbers of a store by set of gains."""
    campaign, statistics_by_set = evaluator.campaign, {}
    for name in map(str, data.gains.values):
        chosen = data.sel(gains=name)
        lost, gap_messages = np.isfinite(chosen.diverged_at.values), ("",) * len(chosen.sample)
        if "gap" in chosen:
            names, largest = map(str, chosen.grasp.values), map(float, chosen.max_gap.values)
            allowed = dict(zip(names, largest, strict=True))
            gaps = (dict(zip(allowed, map(float, row), strict=True)) for row in chosen.gap.values)
            gap_messages = tuple(unclosed(gap, allowed) for gap in gaps)
        open_ = np.array([bool(words) for words in gap_messages], dtype=np.bool_)
        metric_names = [str(metric) for metric in campaign.metrics if metric in chosen]
        values = {m: chosen[m].values for m in metric_names}
        metrics = {m: np.where(lost[:, None] | np.isnan(v), np.inf, v) for m, v in values.items()}
        failed = {"unclosed": open_} if "gap" in chosen else {}
        failed["diverged"] = lost & ~open_
        missed = None
        if CAPTURED in chosen:
            missed = np.asarray(~(chosen[CAPTURED].values > 0).all(axis=1), dtype=np.bool_)
            if campaign.require_captures:
                failed[MISSED] = missed & ~lost
        for metric, most in campaign.limits.given.items():
            if metric in metrics:
                over = (metrics[metric].max(axis=1) > most) & ~lost
                if MISSED in failed and find_quantity(metric).exists is not None:
                    over &= ~failed[MISSED]  # a missed capture exceeds every limit of its time
                failed[str(find_quantity(metric).limit)] = over
        places = {m: tuple(map(str, chosen[f"{m}_of"].values)) for m in metric_names}
        units = {m: str(chosen[m].attrs["units"]) for m in metric_names}
        statistics_by_set[name] = SampleStatistics(metrics, places, units, failed, gap_messages, missed)
    return statistics_by_set


def summarise(folder: StrPath, evaluator: CampaignEvaluator) -> dict[str, Any]:
    """Percentiles, failure probabilities, worst samples and sensitivities, also written to ``summary.json``.

    Args:
        folder: A campaign's store.
        evaluator: Evaluator of the campaign; see :func:`optim.campaign.reopen`.

    Raises:
        ResultError: If the store holds no sample, or cannot be read or written.
    """
    folder = Path(folder)
    summary = summary_data(folder, evaluator)
    write_text(folder / SUMMARY, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    return summary


def summary_data(folder: StrPath, evaluator: CampaignEvaluator) -> dict[str, Any]:
    """Summary that :func:`summarise` writes, as plain data.

    Args:
        folder: Folder of the campaign.
        evaluator: Evaluator of the campaign.

    Raises:
        ResultError: If the campaign cannot be read, or holds no sample yet.
    """
    folder = Path(folder)
    data, campaign = load_campaign(folder), evaluator.campaign
    named = named_in(load_head(folder)["notes"])
    if len(data.sample) == 0:
        raise ResultError("holds no sample yet", source=folder)
    statistics_by_set = sample_statistics(data, evaluator)
    draws = data.draw.values
    trust = untrusted(data, {name: sampled.any_failure for name, sampled in statistics_by_set.items()})
    # warnings about samples whose grasps did not close
    warnings = []
    for name, sampled in statistics_by_set.items():
        words = [words for words in sampled.unclosed if words]
        if words:
            count = f"{len(words)} of {len(sampled.unclosed)} samples"
            warnings.append(f"gains {name}: {count} fail before they begin; the first: {words[0]}")
    # every two sets of gains on the same samples: how often one is better, and which fails where
    against = []
    for (a, first), (b, second) in combinations(statistics_by_set.items(), 2):
        for metric in first.metrics:
            one, other = first.largest(metric), second.largest(metric)
            better, differ = int((one < other).sum()), int((one != other).sum())
            interval = _interval(share(better, differ, campaign.confidence), campaign) if differ else None
            against.append({"first": a, "second": b, "metric": metric, "first_is_better": interval})
        fails = {a: first.any_failure, b: second.any_failure}
        only = {name: int((fails[name] & ~fails[rest]).sum()) for name, rest in ((a, b), (b, a))}
        against.append({"first": a, "second": b, "fails_alone": only})
    matters = dict[str, dict[str, Any]]()  # of each metric, and of missed captures
    for name, sampled in statistics_by_set.items():
        values = {metric: sampled.largest(metric) for metric in sampled.metrics}
        if sampled.missed is not None:
            values[MISSED] = sampled.missed.astype(float)
        complete = len(draws) == campaign.count
        matters[name] = {
            key: what_matters(draws, metric_values, campaign, complete=complete)
            for key, metric_values in values.items()
        }
    return {
        "name": evaluator.scene.scenario.name,
        "samples": len(data.sample),
        "of": campaign.count,
        "design": campaign.design,
        "seed": campaign.seed,
        "confidence": campaign.confidence,
        "intervals": campaign.sampler.has_intervals,
        "limits": campaign.limits.model_dump(exclude_none=True),
        "require_captures": campaign.require_captures,
        "parameters": list(campaign.parameters),
        "units": units_of(evaluator.members[0].scene, campaign, evaluator.members[0].space),
        "sensor_offsets": sensor_offsets(campaign),
        "correlated": correlated(campaign),
        "gains": {
            name: {
                "failure": {
                    cause: _rate(hits, campaign)
                    for cause, hits in {"any": sampled.any_failure, **sampled.failed}.items()
                },
                "captured": None if sampled.missed is None else _rate(~sampled.missed, campaign),
                "plans": _plans(data.sel(gains=name)),
                "metrics": _percentiles(sampled, campaign),
                "matters": matters[name],
                "map": _map(sampled, draws, campaign),
                "worst": _worst(sampled, data, evaluator, index, named),
            }
            for index, (name, sampled) in enumerate(statistics_by_set.items())
        },
        "rank_noise": noise_of(len(data.sample), campaign),
        "against": against,
        "untrusted": trust,
        "caveats": [*warnings, *caveats(trust, campaign)],
    }


def _plans(chosen: xr.Dataset) -> dict[str, Any] | None:
    """Numbers of plans that model predictive control solved and missed, and their solve times [s].

    None if the campaign has no planner.
    """
    if "mpc_plans" not in chosen:
        return None
    values = {name: chosen[name].values[:, 0] for name in (*PLANS, *SOLVE_TIMES)}
    values = {name: column[np.isfinite(column)] for name, column in values.items()}
    total = {name.removeprefix("mpc_"): int(values[name].sum()) for name in PLANS}
    median, longest = (values[name] for name in SOLVE_TIMES)
    return total | {
        "median_solve_s": _plain(np.median(median)) if median.size else None,
        "longest_solve_s": _plain(longest.max(initial=0.0)),
        "without_plan": int((~np.isfinite(chosen["mpc_plans"].values)).sum()),
    }


def _percentiles(sampled: SampleStatistics, campaign: Campaign) -> list[dict[str, Any]]:
    rows = []
    for metric, values in sampled.metrics.items():
        for place, column in zip(sampled.places[metric], values.T, strict=True):
            percentile_rows = [
                {"percent": q} | _interval(percentile(column, q, campaign.confidence), campaign)
                for q in campaign.percentiles
            ]
            row = {"metric": metric, "of": place, "unit": sampled.units[metric]}
            rows.append(row | {"percentiles": percentile_rows, "largest": _plain(column.max())})
    return rows


def _rate(hits: np.typing.NDArray[np.bool_], campaign: Campaign) -> dict[str, Any]:
    """Count the hits, and estimate their probability."""
    count = int(hits.sum())
    return {"count": count} | _interval(share(count, len(hits), campaign.confidence), campaign)


def _interval(estimate: Estimate, campaign: Campaign) -> dict[str, Any]:
    """Plain form: null is infinite or open; designs whose samples are not independent have no interval."""
    ends = (estimate.low, estimate.high) if campaign.sampler.has_intervals else (None, None)
    return {"value": _plain(estimate.value), "low": _plain(ends[0]), "high": _plain(ends[1])}


def _map(sampled: SampleStatistics, draws: Array, campaign: Campaign) -> dict[str, Any] | None:
    """Map of failures on a grid over two parameters: causes by level of the first and of the second."""
    if not campaign.sampler.is_factorial or draws.shape[1] != 2 or len(draws) != campaign.count:
        return None
    levels = [np.unique(column) for column in draws.T]
    causes = np.full(len(draws), "", dtype=object)
    for cause, hits in reversed(list(sampled.failed.items())):
        causes[hits] = cause
    cells: list[list[str]] = [[""] * len(levels[1]) for _ in levels[0]]
    for draw, cause in zip(draws, causes, strict=True):
        i, j = (int(np.searchsorted(level, value)) for level, value in zip(levels, draw, strict=True))
        cells[i][j] = cause
    first, second = (list(map(float, level)) for level in levels)
    return {"first": first, "second": second, "failed": cells}


def _worst(
    sampled: SampleStatistics,
    data: xr.Dataset,
    evaluator: CampaignEvaluator,
    index: int,
    named: ScenarioSource,
) -> list[dict[str, Any]]:
    """Worst samples, the most severe first.

    Samples that did not start come last, and missed captures come before others. Within these groups the
    order is by :meth:`SampleStatistics.badness`, then by miss distance, the largest first, then by the time
    of divergence, the earliest first.
    """
    name, times = str(data.gains.values[index]), data.diverged_at.values[:, index]
    metrics, badness = sampled.badness(evaluator.campaign)
    open_ = np.array([bool(words) for words in sampled.unclosed])
    missed = np.zeros(len(open_), dtype=np.bool_) if sampled.missed is None else sampled.missed
    distance = (
        sampled.largest("miss_distance") if "miss_distance" in sampled.metrics else np.zeros(len(open_))
    )
    late = np.where(np.isnan(times), np.inf, times)
    order = np.lexsort((late, -distance, -badness, ~missed, open_))[:WORST]
    rows = []
    for i in order:
        draw, metric = data.draw.values[i], metrics[i]
        rows.append(
            {
                "sample": int(data.sample.values[i]),
                "metric": metric,
                "value": _plain(sampled.largest(metric)[i]),
                "diverged_at_s": None if open_[i] else _plain(times[i]),
                "unclosed": sampled.unclosed[i] or None,
                "missed": bool(missed[i]),
                "failed": [cause for cause, hits in sampled.failed.items() if hits[i]],
                "draw": dict(zip(evaluator.campaign.parameters, map(float, draw), strict=True)),
                "command": command_of(evaluator, draw, name, named.scenario, named.changes),
            }
        )
    return rows


def _plain(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)
