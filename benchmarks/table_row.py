"""A row of the table."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.timing import Paired


@dataclass(frozen=True)
class Row:
    """One thing measured.

    Attributes:
        what, against: What was measured, and beside what.
        ours, theirs: Measured, as text with units.
        ratio: Of the two, as the target counts it; none where nothing is compared.
        target: What it must reach, as text.
        met: Whether it does; none where it is only stated.
        note: An honest word.
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
        names: What was measured, and against what.
        times: Of the jobs.
        note: An honest word.
        count: Rollouts of one job, by which the times are divided that are printed.
    """
    ratio = times.first_s / times.second_s
    texts = (f"{each / count * 1e3:.2f} ms" for each in (times.first_s, times.second_s))
    return Row(*names, *texts, ratio, f"at most {most:g} times", ratio <= most, note)


def markdown_head(columns: Sequence[str]) -> list[str]:
    """The first two lines of a table in Markdown."""
    return [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]


HAND_S = 0.1
"""The time in which a hand sees no delay."""


def hand_row(what: str, times_s: Sequence[float], note: str, values: Mapping[str, Any]) -> Row:
    """Row about times from a hand's change to its answer: their median, and their 95th percentile's share."""
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
