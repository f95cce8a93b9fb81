"""Values of constraints whose expressions contain results of inner iterations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.shapes import Implicit

STEPS, APART_AFTER, SLOPE = 30, 8, 1e-10
"""Maximum number of Newton steps, the number after which shapes count as overlapping if no step has shown
them apart, and the slope at which a maximum is converged [m]."""

Call = Callable[..., Array]
"""Evaluates a function, by name, for columns (n, N)."""


def implicit_in(rows: Sequence[BoundedRow]) -> list[Implicit]:
    """Inner iterations on which the constraints depend."""
    return [row.about for row in rows if row.about is not None and row.about.function is not None]


def symbols_of(implicits: Sequence[Implicit]) -> ca.SX:
    """Symbols of the results of inner iterations (n x 1)."""
    return ca.vertcat(ca.SX(0, 1), *(one.symbol for one in implicits))


def implicit_values(
    implicit: Sequence[Implicit], inputs: Array, call: Call, near: Array | None = None
) -> Array:
    """Results of inner iterations (n, N), for all columns by one call of each function.

    Args:
        implicit: Inner iterations.
        inputs: Values of their ``arguments``, stacked (m, N).
        call: Evaluates one of their functions, by name, for columns.
        near: Results for inputs close by, from which steps begin; ignored if their number differs.
    """
    count = inputs.shape[1]
    is_near = near is not None and near.shape[1] == count
    ends = np.cumsum([one.symbol.numel() for one in implicit])[:-1]
    starts = np.split(near, ends) if is_near and near is not None else [np.zeros((3, count))] * len(implicit)
    parts = np.split(inputs, np.cumsum([one.arguments.numel() for one in implicit])[:-1]) if implicit else []
    values: list[Array] = [np.empty((0, count))] * len(implicit)
    for name in {one.function.name(): None for one in implicit if one.function is not None}:
        matching = [
            k for k, one in enumerate(implicit) if one.function is not None and one.function.name() == name
        ]
        first = np.hstack([starts[k][:3] for k in matching])
        columns_in = np.hstack([parts[k] for k in matching])
        columns = _solve_implicit(implicit[matching[0]], columns_in, call, first)
        for k, value in zip(matching, np.hsplit(columns, len(matching)), strict=True):
            values[k] = value
    return np.vstack([np.empty((0, count)), *values])


def functions_of(implicits: Sequence[Implicit]) -> dict[str, ca.Function]:
    """Functions that evaluate the inner iterations, by name."""
    functions = (function for one in implicits for function in (one.function, one.ascent))
    return {function.name(): function for function in functions if function is not None}


def _solve_implicit(implicit: Implicit, inputs: Array, call: Call, directions: Array) -> Array:
    """Solutions (m, N) of one inner iteration for columns of inputs (n, N).

    Newton steps find the direction between convex shapes that are apart, from the initial ones (3, N);
    a zero column begins at the direction between the centres. Columns of shapes that overlap, or that do not
    converge, are solved by the fixed iteration.
    """
    assert implicit.function is not None
    if implicit.ascent is None:
        return call(implicit.function.name(), inputs)
    count = inputs.shape[1]
    solutions, active, remaining = np.empty((implicit.symbol.numel(), count)), np.arange(count), list[int]()
    for k in range(STEPS):
        step = call(implicit.ascent.name(), inputs[:, active], directions)
        directions, solution, (value, slope) = step[:3], step[3:9], step[9:]
        converged = (value > 0) & (slope < SLOPE)
        solutions[:, active[converged]] = solution[:, converged]
        overlaps = ~converged & ~(value > 0) & (k >= APART_AFTER)
        remaining += active[overlaps].tolist()
        continuing = ~converged & ~overlaps
        active, directions = active[continuing], directions[:, continuing]
        if not active.size:
            break
    remaining += active.tolist()
    if remaining:
        solutions[:, remaining] = call(implicit.function.name(), inputs[:, remaining])
    return solutions


def row_values(rows: Sequence[BoundedRow], at: ca.SX, columns: Array) -> Array:
    """Values of constraints (rows, N) at values of a symbol (n x 1), one for each column (n, N)."""
    implicit, size = implicit_in(rows), columns.shape[1]
    symbols = symbols_of(implicit)
    inputs = ca.Function("given", [at], [ca.vertcat(ca.SX(0, 1), *(one.arguments for one in implicit))])
    functions = functions_of(implicit)

    def call(name: str, *arguments: Array) -> Array:
        """Evaluate one of the functions."""
        return np.array(functions[name](*arguments).full())

    held = (
        implicit_values(implicit, np.array(inputs(columns).full()), call) if implicit else np.empty((0, size))
    )
    values = ca.Function("rows", [at, symbols], [ca.densify(ca.vertcat(*(row.value for row in rows)))])
    return np.array(values(columns, held).full()).reshape(len(rows), size)
