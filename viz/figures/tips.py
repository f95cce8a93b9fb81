"""Tips: paths beside their references (the paper's Fig. 5) and errors (Fig. 7 and 10)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from spacerobot.paper import AXES, FIGURE_7_MM, FIGURE_10_MM
from spacerobot.result import Result
from viz.figures.style import (
    DASHES,
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

    In a spatial scene the panels show the two world axes along which the reference reaches farthest. Errors
    too small to be seen are drawn once more, enlarged.
    """
    tips = [str(tip) for tip in results[0].data.tip.values]
    figure, axes = panels(len(results), len(tips), height_in=3.0)
    letters = iter(_FIGURE_5_PANELS * 4)
    for row, result, label in zip(axes, results, labels_of(results), strict=True):
        for panel, tip in zip(row, tips, strict=True):
            _path(panel, result, tip)
            title = f"({next(letters)}) {tip}"
            panel.set_title(title if len(results) == 1 else f"{title}, {label}", pad=16)
    legend_above(figure, *axes.flat)
    return figure


def _path(panel: Axes, result: Result, tip: str) -> None:
    reference = result.data.tip_reference.sel(tip=tip).values
    actual = result.data.tip_position.sel(tip=tip).values
    reach = np.ptp(reference, axis=0)
    across, up = (int(k) for k in sorted(np.argsort(-reach, kind="stable")[:2]))
    names = [str(result.data.axis.values[k]) for k in (across, up)]
    panel.plot(reference[:, across], reference[:, up], **line(1), label="reference", linewidth=1.0, zorder=4)
    panel.plot(actual[:, across], actual[:, up], **line(0), label="actual", linewidth=2.2, alpha=0.75)
    greatest = float(np.linalg.norm(result.data.tip_error.sel(tip=tip).values, axis=-1).max())
    times = enlargement(greatest, float(reach.max()))
    if times > 1:
        shown = reference + times * (actual - reference)
        look = {"linestyle": DASHES[2], "linewidth": 1.0, "color": "#444444"}
        panel.plot(shown[:, across], shown[:, up], **look, label="actual, error enlarged", zorder=3)
    panel.plot(actual[0, across], actual[0, up], "o", color="black", markersize=4, label="start", zorder=5)
    panel.set_xlabel(f"{names[0]} [m]")
    panel.set_ylabel(f"{names[1]} [m]")
    panel.set_aspect("equal", adjustable="datalim")
    panel.locator_params(nbins=5)
    ended = "" if result.completed else f"; diverged after {result.data.time.values[-1]:.3g} s"
    larger = f", enlarged {times:g} times" if times > 1 else ""
    words = f"greatest error {greatest * 1e3:.3g} mm{larger}{ended}"
    panel.text(0.0, 1.02, words, transform=panel.transAxes, fontsize=7.5)


def enlargement(error: float, reach: float) -> float:
    """Round factor by which an error [m] is seen beside a path of this reach [m]; 1 if it is seen anyway."""
    if error <= 0 or error > 0.04 * reach:
        return 1.0
    wanted = 0.12 * reach / error
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(k * power for k in (1, 2, 5) if k * power <= wanted))


@styled
def tip_errors(*results: Result) -> Drawing:
    """Tip errors, reference minus position (Fig. 7 and 10): a row for each tip, a column for each axis.

    All panels have one scale. The paper's bands lie behind where the scenario is called ``paper``. Several
    results, before and after tuning for example, are drawn over each other; a last column then shows the size
    of their errors on a logarithmic scale, on which the smaller ones are seen as well.
    """
    tips, names = [str(tip) for tip in results[0].data.tip.values], shown_axes(results[0])
    several = len(results) > 1
    figure, axes = panels(len(tips), len(names) + several, sharex=True)
    signed = axes[:, : len(names)]
    for panel in signed.flat[1:]:
        panel.sharey(signed[0, 0])
    for row, tip in zip(axes, tips, strict=True):
        for panel, name in zip(row, names, strict=False):
            _errors(panel, results, tip, name)
            panel.label_outer()
        if several:
            _sizes(row[-1], results, tip, last=tip == tips[-1])
    _limit(signed, results)
    legend_above(figure, axes[0, 0], columns=3)
    return figure


def _errors(panel: Axes, results: Sequence[Result], tip: str, name: str) -> None:
    """Errors of a tip along an axis, over the paper's bands."""
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


def _sizes(panel: Axes, results: Sequence[Result], tip: str, *, last: bool) -> None:
    """Sizes of a tip's errors, whatever their direction."""
    for index, result in enumerate(results):
        size = np.linalg.norm(result.data.tip_error.sel(tip=tip).values, axis=-1) * 1e3
        # a tip begins on its reference: zeros do not show on a logarithmic axis
        panel.plot(result.data.time.values, np.where(size > 0, size, np.nan), **line(index))
        until(panel, result)
    greatest = panel.dataLim.y1
    if np.isfinite(greatest) and greatest > 0:
        panel.set_ylim(max(panel.dataLim.minposy, 1e-6 * greatest), 2 * greatest)
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.set_title(f"{tip}, size")
    panel.set_ylabel("size of tip error [mm]")
    panel.set_xlabel("time [s]" if last else "")


def _bands(panel: Axes, tip: str, name: str) -> None:
    """What the paper prints for this tip and axis, if it does."""
    if (tip, name) not in AXES:
        return
    seventh, tenth = FIGURE_7_MM[AXES.index((tip, name))], FIGURE_10_MM[AXES.index((tip, name))]
    panel.axhspan(*seventh, color=PAPER_FILL, linewidth=0, label="paper, Fig. 7 (PID + amnesia)", zorder=0)
    for k, value in enumerate(tenth):
        label = "paper, Fig. 10 (GA-tuned)" if k == 0 else None
        panel.axhline(value, color=PAPER_LINE, linewidth=0.8, linestyle=(0, (3, 2)), label=label, zorder=1)


def _limit(axes: np.ndarray[tuple[int, int], np.dtype[np.object_]], results: Sequence[Result]) -> None:
    """Keep what happened before a divergence readable: its last instants leave the panel."""
    if all(result.completed for result in results):
        return
    values = [result.data.tip_error.values * 1e3 for result in results]
    calm = max(
        float(np.abs(v if r.completed else v[: max(2, int(0.8 * len(v)))]).max())
        for v, r in zip(values, results, strict=True)
    )
    axes[0, 0].set_ylim(-2 * max(calm, 1.0), 2 * max(calm, 1.0))
