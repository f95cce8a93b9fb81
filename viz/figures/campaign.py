"""Campaign figures: distributions of metrics over the samples. The input is plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter
from numpy.typing import ArrayLike

from spacerobot.common.arrays import Array
from viz.figures.style import COLOURS, Drawing, legend_above, line, panel_grid, panels, styled

DECADES = 1.5  # of values, from which on they stand on a logarithmic axis
ZERO = 1e-8  # of the largest value; below it sizes are smoothed, as 1e-6 N where there is no force
FAR = 2.5  # how many times the values' own reach a limit may lie outside it and still be drawn
BAD, BEYOND = "#B00020", "#FBE9EA"


@dataclass(frozen=True)
class SampleSpread:
    """A metric over many samples.

    Attributes:
        samples: Values (n,) by name of the design; NaN or infinite where a rollout diverged or has no such
            value, as the time of a missed capture, which counts as worse than any value.
        quantity, unit: Name and unit of the metric.
        limit: Upper limit of the metric; None without one.
        missing: Reason for missing values, in a word or two.
    """

    samples: Mapping[str, ArrayLike]
    quantity: str
    unit: str
    limit: float | None = None
    missing: str = "diverged"


@styled
def robustness(
    samples: Mapping[str, ArrayLike], *, quantity: str, unit: str, limit: float | None = None
) -> Drawing:
    """Cumulative distribution of a quantity over perturbed runs for each design, with two quantiles.

    The marked quantiles are the median and that of 95 %.

    Args:
        samples, quantity, unit, limit: See :class:`SampleSpread`.
    """
    figure, axes = panels(1, 1, height_in=2.2 + 0.17 * len(samples))  # the legend has a line for each
    _draw(axes[0, 0], SampleSpread(samples, quantity, unit, limit), numbers=True)
    legend_above(figure, axes[0, 0], columns=1)
    return figure


@styled
def distributions(spreads: Sequence[SampleSpread]) -> Drawing:
    """Distributions of several metrics, one panel for each.

    Args:
        spreads: Spread of each panel, all of the same designs.
    """
    figure, axes = panel_grid(len(spreads), 2, height_in=2.1)
    for panel, spread in zip(axes.flat, spreads, strict=False):
        _draw(panel, spread, numbers=False)
        panel.set_title(spread.quantity)
    if len(spreads[0].samples) > 1:
        legend_above(figure, axes[0, 0], columns=4)
    return figure


def _draw(panel: Axes, spread: SampleSpread, *, numbers: bool) -> None:
    """Curves of one quantity; with their numbers in the legend, or at their marks."""
    sample_values = [np.asarray(values, dtype=np.float64) for values in spread.samples.values()]
    labels: list[tuple[str, float, float]] = []
    alone = len(sample_values) == 1
    for k, (name, values) in enumerate(zip(spread.samples, sample_values, strict=True)):
        finite = np.sort(values[np.isfinite(values)])
        share = np.arange(1, len(finite) + 1) / max(len(values), 1)
        # Percentiles of all runs, where enough have not diverged.
        runs = len(values)
        places = {level: level * (runs - 1) for level in (0.5, 0.95)}
        inside = {level: at for level, at in places.items() if at <= len(finite) - 1}
        marks = {level: float(np.interp(at, np.arange(len(finite)), finite)) for level, at in inside.items()}
        label, texts = name, _apart(marks)
        if numbers:
            parts = [f"{100 * level:g} % below {text} {spread.unit}" for level, text in texts.items()]
            gone = [f"{runs - len(finite)} {spread.missing}"] if len(finite) < runs else []
            label = f"{name}: {', '.join([f'{runs} runs', *parts, *gone])}"
        panel.plot(finite, share, drawstyle="steps-post", **line(k), label=label)
        for level, text in texts.items():
            value = marks[level]
            panel.plot(value, level, "o", color=COLOURS[k % len(COLOURS)], markersize=4)
            if alone and not numbers:
                labels.append((f"  {100 * level:g} % below {text}  ", value, level))
        if 0 < len(finite) < len(values) and not numbers:
            # Say at the right edge where a curve ends short of all runs because some have no value.
            end = len(finite) / len(values)
            lost = len(values) - len(finite)
            colour = BAD if alone else COLOURS[k % len(COLOURS)]
            panel.axhline(end, color=colour, linewidth=0.8, linestyle=":")
            edge: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "bottom"}
            panel.annotate(f"{lost} {spread.missing}", (1, end), fontsize=7, color=colour, **edge)
    every = np.concatenate(sample_values) if sample_values else np.empty(0)
    if np.isfinite(every).any():
        _scale(panel, every[np.isfinite(every)], spread)
    elif len(every):
        panel.set_xticks([])
        centre: dict[str, Any] = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
        panel.annotate(f"all of {len(every)} {spread.missing}", (0.5, 0.5), **centre, color=BAD)
    panel.set_ylim(0, 1.04)
    for note, value, level in labels:
        # on the side of the mark where there is more room
        across = panel.transAxes.inverted().transform(panel.transData.transform((value, level)))[0]
        place: dict[str, Any] = (
            {"ha": "left", "va": "top"} if across < 0.55 else {"ha": "right", "va": "center"}
        )
        behind = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.5}
        panel.annotate(note, (value, level), fontsize=7, color="0.25", bbox=behind, zorder=1.5, **place)
    panel.yaxis.set_major_formatter(PercentFormatter(1.0))
    panel.set(
        xlabel=f"{spread.quantity} [{spread.unit}]" if numbers else f"[{spread.unit}]",
        ylabel="runs that stay below [%]" if numbers else "samples that stay below [%]",
    )


def _apart(marks: Mapping[float, float]) -> dict[float, str]:
    """Text of each value, with as many significant digits, at least three, as make the texts distinct."""
    texts: dict[float, str] = {}
    for digits in range(3, 16):
        texts = {level: f"{value:.{digits}g}" for level, value in marks.items()}
        if len(set(texts.values())) == len(set(marks.values())):
            break
    return texts


def _scale(panel: Axes, finite: Array, spread: SampleSpread) -> None:
    """Choose the axis, and draw the limit if it is within reach of the values."""
    limit = spread.limit
    reach = float(finite.min()), float(finite.max())
    wide = reach[0] > ZERO * reach[1] and np.log10(reach[1] / reach[0]) > DECADES
    if wide:
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    elif reach[1] - reach[0] < 1e-9 * abs(reach[1]):
        room = 0.05 * abs(reach[1]) or 1.0
        panel.set_xlim(reach[0] - room, reach[1] + room)
    if limit is None:
        return
    text = f"limit {limit:g} {spread.unit}"
    far = 10 if wide else FAR
    if reach[0] / far <= limit <= reach[1] * far:
        panel.axvline(limit, color=BAD, linewidth=0.9, linestyle="--")
        end = max(panel.get_xlim()[1], limit * 1.05)
        panel.axvspan(limit, end, color=BEYOND, zorder=0, linewidth=0)
        panel.set_xlim(right=end)
        place: dict[str, Any] = {"xy": (limit, 0.03), "xycoords": ("data", "axes fraction"), "ha": "right"}
        panel.annotate(f"{text} ", **place, fontsize=7, color=BAD, rotation=90, va="bottom")
    else:
        right = limit > reach[1]
        text = f"{text}, far to the right →" if right else f"← {text}, far to the left"
        place = {"xy": (0.99 if right else 0.01, 0.03), "xycoords": "axes fraction"}
        panel.annotate(text, **place, fontsize=7, color=BAD, ha="right" if right else "left", va="bottom")
