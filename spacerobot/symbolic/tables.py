"""Tables of numbers of which a rollout sees one row at a time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WindowTable:
    """Rows of equal width in c, one after the other, and a window that shows one of them.

    Attributes:
        cursor: Which of the cursors tells the row.
        first, window: Where in c the first row and the window begin.
        width, count: Numbers in a row, and rows.
        noise: Place of the first row among the random numbers of a rollout; -1 where the rows are in c.
    """

    cursor: int
    first: int
    window: int
    width: int
    count: int
    noise: int = -1
