"""Tuning: convergence, and sensitivities of gains. They take plain data, whatever made it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from viz.figures.style import COLOURS, Drawing, legend_above, line, panels, styled


@styled
def convergence(
    runs: Mapping[str, ArrayLike], *, quantity: str, unit: str, step: str = "generation", log: bool = True
) -> Drawing:
    """Best value so far over the steps of each run.

    Parameters
    ----------
    runs
        By name of the run: values at steps (n,), or steps and values (n, 2). Values that are not finite, of
        candidates that diverged, are left out.
    quantity, unit
        What was made small, and its unit.
    step
        What the steps are: generation, evaluation, iteration, or a time with its unit in brackets.
    log
        Whether the values stand on a logarithmic axis.
    """
    figure, axes = panels(1, 1, height_in=2.8)
    panel = axes[0, 0]
    for k, (name, given) in enumerate(runs.items()):
        values = np.asarray(given, dtype=np.float64)
        steps, values = (values[:, 0], values[:, 1]) if values.ndim == 2 else (np.arange(len(values)), values)
        best = np.fmin.accumulate(np.where(np.isfinite(values), values, np.nan))
        panel.plot(steps, best, drawstyle="steps-post", **line(k), label=name)
    panel.set_xlabel(step if "[" in step else f"{step} [1]")
    panel.set_ylabel(f"best {quantity} so far [{unit}]")
    if log:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panel.yaxis.set_minor_formatter(lambda value, _: f"{value:.2g}")
    legend_above(figure, panel)
    return figure


@styled
def sensitivities(
    paths: Sequence[str], values: Mapping[str, ArrayLike], *, quantity: str, most: int = 20
) -> Drawing:
    """How strongly each gain acts: relative sensitivities (p / J) dJ/dp, strongest first.

    Parameters
    ----------
    paths
        Dotted paths of the gains (k,).
    values
        By name of the design at which they were taken: sensitivities (k,), without unit.
    quantity
        What J is.
    most
        How many gains are shown.
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
    panel.set_xlabel(f"change of {quantity} for a change of the gain, both relative [1]")
    legend_above(figure, panel)
    return figure
