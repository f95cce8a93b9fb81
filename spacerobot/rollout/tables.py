"""Windows into tables of constants, refilled when a row changes, as ``loops/tables.hpp`` does in C++."""

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
    """Copy the row of each cursor from the tables into their windows in the constants (..., nc).

    Args:
        tables, rows, c: Tables, row of each cursor, and constants.
        slopes: Index in c of each constant's derivative, or -1; empty without derivatives.
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
    """Add the adjoints of windows in cbar to those of the table rows that the windows held, and clear them.

    Args:
        tables, rows, cbar: Tables, row of each cursor, and adjoints of the constants.
        bars: Index in cbar of each constant's adjoint, or -1.
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
    """Indices in c that no function sees."""
    return {place for _, place, _ in cells(tables)}


def reached_with(tables: Sequence[WindowTable], reached: set[int]) -> set[int]:
    """Indices in c that depend on parameters, including windows of table rows that do."""
    return reached | {window for window, place, _ in cells(tables) if place in reached}


def places_in(reached: Sequence[int], count: int, first: int = 0) -> tuple[int, ...]:
    """Position of each of ``count`` constants in ``reached``, plus ``first``; -1 for the others."""
    places = {place: first + i for i, place in enumerate(reached)}
    return tuple(places.get(place, -1) for place in range(count))
