"""Figures of tuning, from plain data: convergence, running times, data profiles, sensitivities of gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike

from spacerobot.common.arrays import Array
from viz.figures.style import COLOURS, Drawing, legend_above, line, panel_grid, panels, styled

FLOOR = 1e-5  # gap at which a run counts as having met the best known value
POINTS = 240  # of a band
COST = "cost [rollouts]"


@styled
def convergence(
    runs: Mapping[str, Sequence[ArrayLike]], *, targets: Sequence[float] = (), ends: Mapping[str, Any]
) -> Drawing:
    """Gap of the runs of each method to the best known value, over their cost.

    Each method has a panel, all with the same axes: a band from its best to its worst run, their median as a
    line, and the medians of the other methods in the background.

    Args:
        runs: Cost in rollouts and relative gap at each improvement, for each run (n, 2), by method.
        targets: Gaps that are marked.
        ends: Cost at which each run ended (runs,), by method.
    """
    names = list(runs)
    figure, axes = panel_grid(len(names), 4, height_in=1.55, sharex=True, sharey=True)
    most = max((float(np.max(ends[name], initial=1.0)) for name in names), default=1.0)
    costs = np.geomspace(1.0, max(most, 2.0), POINTS)
    # gap so far at each cost; infinite before the first
    gaps = {}
    for name in names:
        steps = [np.asarray(run, dtype=np.float64).reshape(-1, 2) for run in runs[name]]
        places = [np.searchsorted(step[:, 0], costs, side="right") for step in steps]
        best = [np.concatenate([[np.inf], np.maximum(step[:, 1], FLOOR)]) for step in steps]
        gaps[name] = np.array([values[at] for values, at in zip(best, places, strict=True)])
    for k, (panel, name) in enumerate(zip(axes.flat, names, strict=False)):
        for other in names:
            panel.plot(costs, _median(gaps[other]), color="0.75", linewidth=0.7, zorder=1)
        reached = costs <= np.max(ends[name], initial=1.0)
        look = {"color": COLOURS[k % len(COLOURS)]}
        low, high = np.min(gaps[name], axis=0), np.max(gaps[name], axis=0)
        top = np.where(np.isfinite(high), high, 1e12)  # runs that have found nothing yet
        panel.fill_between(costs, low, top, where=reached & np.isfinite(low), alpha=0.25, linewidth=0, **look)
        panel.plot(costs[reached], _median(gaps[name])[reached], linewidth=1.5, **look)
        panel.set_title(f"{name} ({len(gaps[name])} {'run' if len(gaps[name]) == 1 else 'runs'})")
        for target in targets:
            panel.axhline(target, color="0.35", linewidth=0.6, linestyle=":")
    panel = axes[0, 0]
    every = np.concatenate([values.ravel() for values in gaps.values()] or [np.ones(1)])
    finite = every[np.isfinite(every)]
    panel.set_yscale("log")
    panel.set_ylim(FLOOR / 1.6, 2 * float(finite.max(initial=0.1)))
    panel.yaxis.set_major_locator(LogLocator(numticks=7))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g} %"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    _cost_axis(axes[0, 0], 1.0, 1.15 * float(costs[-1]))
    figure.supxlabel(COST, fontsize=8.5)
    figure.supylabel("above the best known value", fontsize=8.5)
    return figure


def _median(gaps: Array) -> Array:
    """Median of runs (runs, n); NaN where half of them have found nothing yet."""
    middle = np.quantile(gaps, 0.5, axis=0, method="inverted_cdf")
    return np.where(np.isfinite(middle), middle, np.nan)


def _cost_axis(panel: Axes, least: float, most: float) -> None:
    panel.set_xscale("log")
    panel.set_xlim(least, most)
    few = most < 100 * least  # decades
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=6))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())


@styled
def running_times(
    times: Mapping[str, Sequence[Sequence[float | None]]], *, targets: Sequence[str]
) -> Drawing:
    """Expected running time of each method to each target, with intervals.

    Args:
        times: Expected running time and both ends of its interval for each target (targets, 3) [rollouts], by
            method; None for infinity. An infinite time is replaced by the text "never met", an infinite
            interval extends to the edge of the panel.
        targets: Labels of the targets.
    """
    names = list(times)
    figure, axes = panels(1, len(targets), height_in=0.7 + 0.21 * len(names), sharey=True, sharex=True)
    table = np.array([times[name] for name in names], dtype=np.float64)  # none is infinite
    every = np.where(np.isnan(table), np.inf, table)
    finite = every[np.isfinite(every)]
    least, most = (finite.min() / 1.6, finite.max() * 1.6) if len(finite) else (1.0, 10.0)
    for column, (panel, target) in enumerate(zip(axes[0], targets, strict=True)):
        for place in range(len(names)):
            expected, low, high = every[place, column]
            if not np.isfinite(expected):
                panel.annotate("never met", (least * 1.1, place), fontsize=7, color="0.45", va="center")
                continue
            look = {"color": COLOURS[place % len(COLOURS)]}
            panel.plot([low, min(high, most)], [place, place], linewidth=1.6, solid_capstyle="butt", **look)
            panel.plot(expected, place, "o", markersize=4.5, **look)
        panel.set_title(f"to {target}")
        _cost_axis(panel, least, most)
        panel.set_xlabel("expected [rollouts]")
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].set_ylim(len(names) - 0.5, -0.5)
    return figure


@styled
def data_profiles(budgets: ArrayLike, shares: Mapping[str, Mapping[str, ArrayLike]]) -> Drawing:
    """Share of all problems, targets and runs that each method solved within a budget.

    Args:
        budgets: In rollouts (n,).
        shares: By method: ``share`` and its interval's ends ``low`` and ``high``, each (n,).
    """
    figure, axes = panels(1, 1, height_in=2.9)
    panel, cost = axes[0, 0], np.asarray(budgets, dtype=np.float64)
    for k, (name, shares_solved) in enumerate(shares.items()):
        low, share, high = (
            np.asarray(shares_solved[key], dtype=np.float64) for key in ("low", "share", "high")
        )
        panel.fill_between(cost, low, high, color=COLOURS[k % len(COLOURS)], alpha=0.1, linewidth=0)
        panel.plot(cost, share, **line(k), label=name)
    _cost_axis(panel, float(cost[0]), float(cost[-1]))
    panel.set_ylim(-0.02, 1.02)
    panel.yaxis.set_major_formatter(PercentFormatter(1.0))
    panel.set(xlabel="budget [rollouts]", ylabel="problems x targets x runs solved [%]")
    legend_above(figure, panel, columns=5)
    return figure


@styled
def sensitivities(
    paths: Sequence[str], values: Mapping[str, ArrayLike], *, quantity: str, most: int = 20
) -> Drawing:
    """Influence of each gain: relative sensitivities (p / J) dJ/dp, strongest first.

    Args:
        paths: Dotted paths of the gains (k,).
        values: By name of the design at which they were taken: sensitivities (k,), without unit.
        quantity: What J is.
        most: How many gains are shown.
    """
    table = np.array([np.asarray(row, dtype=np.float64) for row in values.values()])
    order = np.argsort(-np.abs(table).max(axis=0), kind="stable")[:most]
    figure, axes = panels(1, 1, height_in=0.6 + 0.24 * len(order) * max(1, 0.7 * len(table)))
    panel, thickness = axes[0, 0], 0.8 / len(table)
    hatches = ("", "///", "...", "xx")
    for k, (name, row) in enumerate(zip(values, table, strict=True)):
        place = np.arange(len(order)) + (k - (len(table) - 1) / 2) * thickness
        look = {"color": COLOURS[k % len(COLOURS)], "hatch": hatches[k % len(hatches)], "edgecolor": "white"}
        panel.barh(place, row[order], height=thickness, linewidth=0, **look, label=name)
    panel.axvline(0, color="0.3", linewidth=0.7)
    panel.set_yticks(np.arange(len(order)), [paths[i] for i in order])
    panel.set_ylim(len(order) - 0.5, -0.5)
    panel.grid(visible=False, axis="y")
    panel.set_xlabel(f"change of {quantity} for a change of the gain, both relative")
    legend_above(figure, panel)
    return figure
