"""A row of the table."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Row:
    """One thing measured.

    Attributes
    ----------
    what, against
        What was measured, and beside what.
    ours, theirs
        Measured, as text with units.
    ratio
        Of the two, as the target counts it; none where nothing is compared.
    target
        What it must reach, as text.
    met
        Whether it does; none where it is only stated.
    note
        An honest word.
    numbers
        Raw numbers for the JSON file.
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


def markdown_head(columns: Sequence[str]) -> list[str]:
    """The first two lines of a table in Markdown."""
    return [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]


HAND_S = 0.1
"""The time in which a hand sees no delay."""


def hand_row(what: str, times_s: Sequence[float], note: str, found: Mapping[str, Any]) -> Row:
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
        dict(found),
    )
