"""Tips: paths beside their references (the paper's Fig. 5) and errors (Fig. 7 and 10)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from spacerobot.paper import AXES, FIGURE_7_MM, FIGURE_10_MM
from spacerobot.result import Result
from viz.figures.style import (
    PAPER_FILL,
    PAPER_LINE,
    Drawing,
    labels_of,
    legend_above,
    line,
    panels,
    shown_axes,
    styled,
    until,
)

_FIGURE_5_PANELS = "abcdefghijklmnopqrstuvwxyz"


@styled
def tip_paths(*results: Result) -> Drawing:
    """Reference and actual tip paths (Fig. 5): a row for each result, a column for each tip.

    In a spatial scene the panels show the two world axes along which the reference reaches farthest.
    """
    tips = [str(tip) for tip in results[0].data.tip.values]
    figure, axes = panels(len(results), len(tips), height_in=3.0)
    letters = iter(_FIGURE_5_PANELS * 4)
    for row, result, label in zip(axes, results, labels_of(results), strict=True):
        for panel, tip in zip(row, tips, strict=True):
            _path(panel, result, tip)
            title = f"({next(letters)}) {tip}"
            panel.set_title(title if len(results) == 1 else f"{title}, {label}")
    legend_above(figure, axes[0, 0])
    return figure


def _path(panel: Axes, result: Result, tip: str) -> None:
    reference = result.data.tip_reference.sel(tip=tip)
    actual = result.data.tip_position.sel(tip=tip)
    reach = np.ptp(reference.values, axis=0)
    across, up = sorted(np.argsort(-reach, kind="stable")[:2])
    names = [str(result.data.axis.values[k]) for k in (across, up)]
    panel.plot(
        *(reference.sel(axis=name).values for name in names),
        **line(1),
        label="reference",
        linewidth=1.0,
        zorder=4,
    )
    panel.plot(
        *(actual.sel(axis=name).values for name in names),
        **line(0),
        label="actual",
        linewidth=2.2,
        alpha=0.75,
    )
    start = [float(actual.sel(axis=name)[0]) for name in names]
    panel.plot(*start, "o", color="black", markersize=4, label="start", zorder=5)
    panel.set_xlabel(f"{names[0]} [m]")
    panel.set_ylabel(f"{names[1]} [m]")
    panel.set_aspect("equal", adjustable="datalim")
    error = np.linalg.norm(result.data.tip_error.sel(tip=tip).values, axis=-1).max() * 1e3
    ended = "" if result.completed else f"\ndiverged after {result.data.time.values[-1]:.3g} s"
    panel.text(
        0.5,
        0.5,
        f"greatest error\n{error:.3g} mm{ended}",
        transform=panel.transAxes,
        ha="center",
        va="center",
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2},
        zorder=6,
    )


@styled
def tip_errors(*results: Result) -> Drawing:
    """Tip errors, reference minus position (Fig. 7 and 10): a row for each tip, a column for each axis.

    All panels have one scale. The paper's bands lie behind where the scenario is called ``paper``. Several
    results, before and after tuning for example, are drawn over each other.
    """
    tips, names = [str(tip) for tip in results[0].data.tip.values], shown_axes(results[0])
    figure, axes = panels(len(tips), len(names), sharex=True, sharey=True)
    for row, tip in zip(axes, tips, strict=True):
        for panel, name in zip(row, names, strict=True):
            if results[0].scenario.name == "paper":
                _bands(panel, tip, name)
            for index, (result, label) in enumerate(zip(results, labels_of(results), strict=True)):
                error = result.data.tip_error.sel(tip=tip, axis=name)
                panel.plot(result.data.time.values, error.values * 1e3, **line(index), label=label)
                until(panel, result)
            panel.axhline(0, color="0.5", linewidth=0.6, zorder=1)
            panel.set_title(f"{tip}, {name}")
            panel.set_ylabel("tip error [mm]")
            panel.set_xlabel("time [s]")
            panel.label_outer()
    _limit(axes, results)
    legend_above(figure, axes[0, 0], columns=3)
    return figure


def _bands(panel: Axes, tip: str, name: str) -> None:
    """What the paper prints for this tip and axis, if it does."""
    if (tip, name) not in AXES:
        return
    seventh, tenth = FIGURE_7_MM[AXES.index((tip, name))], FIGURE_10_MM[AXES.index((tip, name))]
    panel.axhspan(*seventh, color=PAPER_FILL, linewidth=0, label="paper, Fig. 7 (PID + amnesia)", zorder=0)
    for k, value in enumerate(tenth):
        label = "paper, Fig. 10 (GA-tuned)" if k == 0 else None
        panel.axhline(value, color=PAPER_LINE, linewidth=0.8, linestyle=(0, (3, 2)), label=label, zorder=1)


def _limit(axes: np.ndarray[tuple[int, int], np.dtype[np.object_]], results: tuple[Result, ...]) -> None:
    """Keep what happened before a divergence readable: its last instants leave the panel."""
    if all(result.completed for result in results):
        return
    values = [result.data.tip_error.values * 1e3 for result in results]
    calm = max(
        float(np.abs(v if r.completed else v[: max(2, int(0.8 * len(v)))]).max())
        for v, r in zip(values, results, strict=True)
    )
    axes[0, 0].set_ylim(-2 * max(calm, 1.0), 2 * max(calm, 1.0))
