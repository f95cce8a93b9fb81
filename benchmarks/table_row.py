"""Rows of the table of benchmarks."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.timing import Paired


@dataclass(frozen=True)
class Row:
    """One measurement.

    Attributes:
        what, against: Names of the measurement and of its baseline.
        ours, theirs: Values of both, as text with units.
        ratio: Ratio of both, in the direction of the target; None without a baseline.
        target: Target, as text.
        met: Whether the target is met; None if the value is only stated.
        note: Conditions of the measurement.
        numbers: Raw numbers for the JSON file.
    """

    what: str
    against: str
    ours: str
    theirs: str = ""
    ratio: float | None = None
    target: str = "stated"
    met: bool | None = None
    note: str = ""
    numbers: dict[str, Any] = field(default_factory=dict)


def at_most(most: float, names: tuple[str, str], times: Paired, note: str, *, count: int = 1) -> Row:
    """Row of two jobs that took turns, of which the first may take ``most`` times as long as the second.

    Args:
        most: Target of the ratio of their medians.
        names: Names of the measurement and of its baseline.
        times: Times of the jobs.
        note: Conditions of the measurement.
        count: Rollouts of one job, by which the printed times are divided.
    """
    ratio = times.first_s / times.second_s
    texts = (f"{each / count * 1e3:.2f} ms" for each in (times.first_s, times.second_s))
    return Row(*names, *texts, ratio, f"at most {most:g} times", ratio <= most, note)


def markdown_head(columns: Sequence[str]) -> list[str]:
    """First two lines of a table in Markdown."""
    return [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]


HAND_S = 0.1
"""Longest delay that a user does not notice [s]."""


def hand_row(what: str, times_s: Sequence[float], note: str, values: Mapping[str, Any]) -> Row:
    """Row of times from a user's change to its effect: median, and ratio of the 95th percentile to HAND_S."""
    median, late = statistics.median(times_s), statistics.quantiles(times_s, n=20)[-1]
    return Row(
        what,
        "the time in which a hand sees no delay",
        f"{median * 1e3:.0f} ms",
        f"{HAND_S * 1e3:.0f} ms",
        late / HAND_S,
        f"95 % within {HAND_S * 1e3:.0f} ms",
        late <= HAND_S,
        f"median of {len(times_s)}, 95th percentile {late * 1e3:.0f} ms; {note}",
        dict(values),
    )
