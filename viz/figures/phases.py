"""Shading of phases and marks of captures in plots over time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spacerobot.result import Result
from spacerobot.result.events import WORDS

_SHADE, _TEXT = "#F1F3F6", "#5F6B77"
_LINE_PT, _LETTER_PT = 9.0, 4.6  # height of a line of 7 pt, and width of a letter
_MARKS = {"captured": "#4F8F77", "released": "#8C96A0", "slipped": "#B05A4A"}


def phases_of(result: Result) -> list[tuple[str, float, float]]:
    """Name, start and end [s] of each phase in order; empty if the scenario has none."""
    phase_starts = [(name, 0.0) for name in list(result.scenario.phases)[:1]]
    phase_starts += [
        (e["who"], e["time_s"]) for e in result.summary.get("events", ()) if e["kind"] == "phase"
    ]
    ends = [*phase_starts, ("", float(result.data.time.values[-1]))]
    return [(name, begin, end) for (name, begin), (_, end) in pairwise(ends)]


def mark_phases(axes: Axes, result: Result, *, named: bool = False) -> None:
    """Shade every second phase, and mark captures and releases of grasps.

    Args:
        axes: Panel to mark.
        result: Result with the phases and events.
        named: Whether phases and marks get labels; for one panel of a figure, before its legend is drawn.
    """
    shade(axes, phases_of(result), named=named)
    for kind, colour in _MARKS.items():
        times = {e["time_s"] for e in result.summary.get("events", ()) if e["kind"] == kind}
        for k, time in enumerate(sorted(times)):
            label = WORDS.get(kind, kind) if named and k == 0 else None
            axes.axvline(time, color=colour, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1, label=label)


def shade(axes: Axes, phases: Sequence[tuple[str, float, float]], *, named: bool = False) -> None:
    """Shade every second phase.

    Args:
        axes: Panel to shade.
        phases: Name, begin and end [s] of each phase.
        named: Whether the names are written: upwards at the begin of each phase, on a light ground above the
            curves. A name less than a line's width after another one is placed below it.
    """
    span = max((end for _, _, end in phases), default=0.0) - min(
        (begin for _, begin, _ in phases), default=0.0
    )
    figure = axes.figure
    width_in = figure.get_size_inches()[0] if isinstance(figure, Figure) else 0.0
    width_pt = 72 * width_in * axes.get_position().width
    lines: list[tuple[float, float]] = []  # begin [pt] and foot [pt below the panel's top] of each name
    for k, (name, begin, end) in enumerate(phases):
        if k % 2:
            axes.axvspan(begin, end, color=_SHADE, linewidth=0, zorder=0)
        if named:
            left = begin / span * width_pt if span > 0 else 0.0
            top = max((foot for other, foot in lines if abs(left - other) < _LINE_PT), default=2.0)
            lines.append((left, top + _LETTER_PT * len(name) + 4))
            place: dict[str, Any] = {"xytext": (1, -top), "textcoords": "offset points", "va": "top"}
            look: dict[str, Any] = {"rotation": 90, "fontsize": 7, "color": _TEXT, "zorder": 5}
            look["bbox"] = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.6}
            axes.annotate(name, (begin, 1.0), xycoords=("data", "axes fraction"), **place, **look)
