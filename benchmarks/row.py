"""A row of the table."""

from __future__ import annotations

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
