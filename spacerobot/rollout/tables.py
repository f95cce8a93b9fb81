"""Windows into tables of constants, filled where a row changes; ``loops/tables.hpp`` does it in each lane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.symbolic import WindowTable

Integers = npt.NDArray[np.int64]


def fill(
    tables: Sequence[WindowTable],
    rows: Integers,
    c: Array,
    slopes: Sequence[int] = (),
    noise: Array | None = None,
) -> None:
    """Let the windows of constants (..., nc) show the rows of their cursors.

    Args:
        tables, rows, c: The tables, the row of each cursor, and the constants.
        slopes: Place in c of each constant's derivative, or -1; none without derivatives.
        noise: Random numbers (n,).
    """
    for table in tables:
        if table.noise >= 0:
            place = table.noise + int(rows[table.cursor]) * table.width
            if noise is not None:
                c[..., table.window : table.window + table.width] = noise[place : place + table.width]
            continue
        begin, window = table.first + int(rows[table.cursor]) * table.width, table.window
        c[..., window : window + table.width] = c[..., begin : begin + table.width]
        for j in range(table.width if slopes else 0):
            if slopes[window + j] >= 0:
                depends = slopes[begin + j] >= 0
                c[..., slopes[window + j]] = c[..., slopes[begin + j]] if depends else 0.0


def gather(tables: Sequence[WindowTable], rows: Integers, bars: Sequence[int], cbar: Array) -> None:
    """Let what flowed back to windows, in cbar, belong to the rows that they showed.

    Args:
        tables, rows, cbar: The tables, the row of each cursor, and the bars.
        bars: Place in cbar of each constant's bar, or -1.
    """
    for table in tables:
        if table.noise >= 0:
            continue
        begin = table.first + int(rows[table.cursor]) * table.width
        for j in range(table.width):
            window, place = bars[table.window + j], bars[begin + j]
            if place >= 0:
                cbar[place] += cbar[window]
            if window >= 0:
                cbar[window] = 0.0


def cells(tables: Sequence[WindowTable]) -> Iterator[tuple[int, int, int]]:
    """Window's place, its table's place, and the table's number, of every entry of every table."""
    for number, table in enumerate(tables):
        if table.noise >= 0:
            continue
        for place in range(table.count * table.width):
            yield table.window + place % table.width, table.first + place, number


def sources(tables: Sequence[WindowTable]) -> set[int]:
    """Places in c that no function sees."""
    return {place for _, place, _ in cells(tables)}


def reached_with(tables: Sequence[WindowTable], reached: set[int]) -> set[int]:
    """Places in c that parameters reach, with the windows that may show them."""
    return reached | {window for window, place, _ in cells(tables) if place in reached}


def places_in(reached: Sequence[int], count: int, first: int = 0) -> tuple[int, ...]:
    """Place of each of so many constants among those that are reached, from ``first`` on; -1 for others."""
    places = {place: first + i for i, place in enumerate(reached)}
    return tuple(places.get(place, -1) for place in range(count))
