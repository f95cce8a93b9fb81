"""Values of rows whose expressions depend on what an iteration finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.shapes import Implicit

Call = Callable[..., Array]
"""Evaluates a function, by name, for columns (n, N)."""


def implicit_in(rows: Sequence[BoundedRow]) -> list[Implicit]:
    """Quantities that iterations find for some rows."""
    return [row.about for row in rows if row.about is not None and row.about.function is not None]


def symbols_of(implicits: Sequence[Implicit]) -> ca.SX:
    """Symbols of what iterations find (n x 1)."""
    return ca.vertcat(ca.SX(0, 1), *(one.symbol for one in implicits))


def implicit_values(implicit: Sequence[Implicit], inputs: Array, call: Call) -> Array:
    """Values that iterations find (n, N), all columns of one function at once.

    Args:
        implicit: Unknowns of iterations.
        inputs: Values of their ``given``, one below the other (m, N).
        call: Evaluates one of their functions, by its name, for columns.
    """
    count = inputs.shape[1]
    parts = np.split(inputs, np.cumsum([one.given.numel() for one in implicit])[:-1]) if implicit else []
    values: list[Array] = [np.empty((0, count))] * len(implicit)
    functions = {one.function.name(): one.function for one in implicit if one.function is not None}
    for name in functions:
        matching = [
            k for k, one in enumerate(implicit) if one.function is not None and one.function.name() == name
        ]
        columns = call(name, np.hstack([parts[k] for k in matching]))
        for k, value in zip(matching, np.hsplit(columns, len(matching)), strict=True):
            values[k] = value
    return np.vstack([np.empty((0, count)), *values])


def row_values(rows: Sequence[BoundedRow], at: ca.SX, columns: Array) -> Array:
    """Values of rows (rows, N) where a symbol (n x 1) has the values of columns (n, N)."""
    implicit, size = implicit_in(rows), columns.shape[1]
    symbols = symbols_of(implicit)
    inputs = ca.Function("given", [at], [ca.vertcat(ca.SX(0, 1), *(one.given for one in implicit))])
    functions = {one.function.name(): one.function for one in implicit if one.function is not None}

    def call(name: str, arguments: Array) -> Array:
        """Evaluate one of the functions."""
        return np.array(functions[name](arguments).full())

    held = (
        implicit_values(implicit, np.array(inputs(columns).full()), call) if implicit else np.empty((0, size))
    )
    values = ca.Function("rows", [at, symbols], [ca.densify(ca.vertcat(*(row.value for row in rows)))])
    return np.array(values(columns, held).full()).reshape(len(rows), size)
