"""Key instants of a motion: its phases, captures and releases, and evenly spaced ones between them."""

from __future__ import annotations

import numpy as np

from spacerobot.result import Result
from spacerobot.result.events import what_happened
from viz.figures.docking import strip
from viz.figures.kind import figure
from viz.figures.phases import phases_of
from viz.figures.style import Drawing, styled

_KINDS = ("captured", "released", "slipped")
_APART = 0.02  # of the duration: events nearer to each other share a picture


def has_instants(result: Result) -> bool:
    """Whether a result has phases, captures or releases."""
    return len(phases_of(result)) > 1 or any(e["kind"] in _KINDS for e in result.summary.get("events", ()))


@figure("The motion at its phases, captures and releases", applies=has_instants, place=5.5)
@styled
def storyboard(result: Result, *, instants: int = 6) -> Drawing:
    """The scene at its events, named; where there are fewer than ``instants``, also in the longest gaps."""
    time = result.data.time.values
    rows, words = chosen(result, instants)
    return strip(result, np.searchsorted(time, rows).clip(0, len(time) - 1), words)


def chosen(result: Result, instants: int) -> tuple[list[float], list[str]]:
    """Times [s], ascending, and their captions; events first, then the middles of the longest gaps."""
    end = float(result.data.time.values[-1])
    events = [
        (e["time_s"], what_happened(e)) for e in result.summary.get("events", ()) if e["kind"] in _KINDS
    ]
    events += [(begin, name) for name, begin, _ in phases_of(result)]
    labels_by_time: dict[float, str] = {0.0: "", end: ""}
    # captures and releases go before the beginnings of phases
    for time, words in events:
        near = next((t for t in labels_by_time if abs(t - time) <= _APART * end), None)
        if near is not None:
            labels_by_time[near] = labels_by_time[near] or words
        elif len(labels_by_time) < instants:
            labels_by_time[float(time)] = words
    while 1 < len(labels_by_time) < instants:  # a result of one instant has no gap
        times = sorted(labels_by_time)
        gaps = np.diff(times)
        widest = int(np.argmax(gaps))
        if gaps[widest] <= 0:
            break
        labels_by_time[times[widest] + gaps[widest] / 2] = ""
    return sorted(labels_by_time), [labels_by_time[time] for time in sorted(labels_by_time)]
