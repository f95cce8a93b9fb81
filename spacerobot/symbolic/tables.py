"""Tables of numbers of which the dynamics use one row at a time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WindowTable:
    """Places of a table's rows and of its window, the copy of the present row.

    Attributes:
        cursor: Index of the cursor that selects the row.
        first, window: Indices in c of the first row and of the window; ``first`` is -1 for noise.
        width, count: Numbers in a row, and number of rows.
        noise: Index of the first row among the random numbers of a rollout; -1 if the rows are in c.
    """

    cursor: int
    first: int
    window: int
    width: int
    count: int
    noise: int = -1
