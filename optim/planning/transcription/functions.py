"""Values and derivatives of a planning problem's instants: compiled in lanes, or interpreted by CasADi."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from optim.planning.formulation.stage import Problem
from spacerobot.arrays import Array
from spacerobot.compiled import Library, compile_functions, find_toolchain
from spacerobot.elements.plan_instant import Surrogate
from spacerobot.errors import CompileError

Places = npt.NDArray[np.int64]
Pattern = tuple[Places, Places]
"""Rows and columns of the entries of a sparse matrix."""


@dataclass(frozen=True, eq=False)
class Instants:
    """Functions of all instants at once, one column for each, and of the last one.

    Attributes
    ----------
    symbolic
        ``values(z -> F)``, ``slopes(z -> J's entries)`` and ``bends(z, weights -> H's entries)`` of one
        instant, with F = (q', what is left of the equations of motion, path rows, terms of the cost) and H
        the upper triangle of the second derivatives of weights . F; ``goal...`` the same of the goal rows
        and of what the last instant costs.
    call
        Evaluates one of them for many columns.
    backend
        ``compiled`` or ``interpreted``.
    slopes, bends, goal_slopes, goal_bends
        Where the entries stand.
    """

    symbolic: Mapping[str, ca.Function]
    call: Callable[..., Array]
    backend: str
    slopes: Pattern
    bends: Pattern
    goal_slopes: Pattern
    goal_bends: Pattern


def build_instants(problem: Problem, backend: str = "auto") -> Instants:
    """Functions of a problem.

    Parameters
    ----------
    problem
        What they are of.
    backend
        ``auto``, ``compiled`` or ``interpreted``.

    Raises
    ------
    CompileError
        If ``compiled`` cannot be had.
    """
    functions: dict[str, ca.Function] = {}
    patterns = []
    for prefix, (expression, about) in _rows(problem).items():
        found, where = derived(problem.stage.z, expression, prefix, about)
        functions |= found
        patterns += where
    call, used = _caller(functions, backend)
    return Instants(functions, call, used, *patterns)


def revalued(instants: Instants, problem: Problem) -> Instants:
    """Functions with the values, interpreted, of a problem that differs by numbers alone; no derivatives."""
    functions = {
        f"{prefix}values": _function(f"{prefix}values", [problem.stage.z], expression)
        for prefix, (expression, _) in _rows(problem).items()
    }
    return dataclasses.replace(instants, symbolic=functions, call=_in_turn(functions), backend="interpreted")


def _rows(problem: Problem) -> dict[str, tuple[ca.SX, dict[int, Surrogate]]]:
    """F of one instant, and the goal's rows, by the prefix of their functions' names.

    With each of them, by number, what is differentiated in place of some rows.
    """
    stage = problem.stage
    parts = {
        "": (ca.vertcat(stage.rate, stage.balance), problem.path, ca.vertcat(*problem.terms.values())),
        "goal_": (ca.SX(0, 1), problem.goal, ca.vertcat(ca.SX(0, 1), *problem.ends.values())),
    }
    found = {}
    for prefix, (before, rows, behind) in parts.items():
        expression = ca.vertcat(before, *(row.value for row in rows), behind)
        about = {before.numel() + k: row.about for k, row in enumerate(rows) if row.about is not None}
        found[prefix] = ca.densify(expression), about
    return found


def derived(
    z: ca.SX, rows: ca.SX, prefix: str, about: Mapping[int, Surrogate] = types.MappingProxyType({})
) -> tuple[dict[str, ca.Function], list[Pattern]]:
    """Values and first and second derivatives of rows, and where the derivatives' entries stand.

    Some rows, by number, may have another expression that is differentiated.
    """
    weights, cheap = ca.SX.sym("weights", rows.numel()), ca.SX(rows)
    for k, other in about.items():
        cheap[k] = other.value
    slopes = ca.jacobian(cheap, z)
    bends = ca.triu(ca.hessian(ca.dot(weights, cheap), z)[0])
    symbols, at = ([getattr(one, name) for one in about.values()] for name in ("symbol", "at"))
    entries = ca.substitute([_entries(slopes), _entries(bends)], symbols, at)
    functions = {
        f"{prefix}values": _function(f"{prefix}values", [z], rows),
        f"{prefix}slopes": _function(f"{prefix}slopes", [z], entries[0]),
        f"{prefix}bends": _function(f"{prefix}bends", [z, weights], entries[1]),
    }
    return functions, [_pattern(slopes), _pattern(bends)]


def _function(name: str, inputs: list[ca.SX], output: ca.SX) -> ca.Function:
    names = ["z", "weights"][: len(inputs)]
    return ca.Function(name, inputs, [ca.densify(output)], names, ["found"], {"cse": True})


def _entries(matrix: ca.SX) -> ca.SX:
    """Entries of a sparse matrix as a dense column."""
    return ca.vertcat(ca.SX(0, 1), matrix.nz[:])


def _pattern(matrix: ca.SX) -> Pattern:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _caller(functions: Mapping[str, ca.Function], backend: str) -> tuple[Callable[..., Array], str]:
    """What evaluates the functions for columns (n, N), and how."""
    toolchain = None if backend == "interpreted" else find_toolchain()
    if toolchain is not None or backend == "compiled":
        try:
            lanes = 1 if toolchain is None else toolchain.lanes
            used = {name: f for name, f in functions.items() if f.numel_out(0)}
            library = compile_functions(used, lanes=lanes, toolchain=toolchain)
        except CompileError:
            if backend == "compiled":
                raise
        else:
            return _in_lanes(library, functions), "compiled"
    return _in_turn(functions), "interpreted"


def _in_lanes(library: Library, functions: Mapping[str, ca.Function]) -> Callable[..., Array]:
    """Groups of columns as wide as the lanes; the last column fills up the last group."""
    lanes = library.lanes

    def call(name: str, *given: Array) -> Array:
        """Values (n, count) of a function at columns of its arguments."""
        count, size = given[0].shape[1], functions[name].numel_out(0)
        out = np.empty((size, count))
        if not size:
            return out
        for begin in range(0, count, lanes):
            end = min(begin + lanes, count)
            wide = [_filled(array[:, begin:end], lanes) for array in given]
            out[:, begin:end] = library(name, *wide)[0][:, : end - begin]
        return out

    return call


def _filled(columns: Array, lanes: int) -> Array:
    """As many columns as there are lanes."""
    missing = lanes - columns.shape[1]
    return np.hstack([columns, np.tile(columns[:, -1:], missing)]) if missing else columns


def _in_turn(functions: Mapping[str, ca.Function]) -> Callable[..., Array]:
    mapped: dict[tuple[str, int], ca.Function] = {}

    def call(name: str, *given: Array) -> Array:
        count = given[0].shape[1]
        if (name, count) not in mapped:
            mapped[name, count] = functions[name].map(count)
        return np.array(mapped[name, count](*given).full()).reshape(-1, count)

    return call
