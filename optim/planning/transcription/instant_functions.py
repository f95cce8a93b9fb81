"""Values and derivatives of a planning problem's instants, compiled (vectorised) or interpreted by CasADi."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from optim.planning.formulation.rows import functions_of, implicit_in, implicit_values, symbols_of
from optim.planning.formulation.stage import PlanningProblem
from spacerobot.common.arrays import Array
from spacerobot.common.errors import CompileError
from spacerobot.compiled import compile_functions, find_toolchain
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.shapes import Implicit

Places = npt.NDArray[np.int64]
Pattern = tuple[Places, Places]
"""Rows and columns of the entries of a sparse matrix."""
NAMES = ("values", "jacobian", "hessian")
"""Names of the functions of rows."""


@dataclass(frozen=True, eq=False)
class InstantFunctions:
    """Vectorised functions of the instants of a plan.

    F stacks q', the residual of the equations of motion, the path rows and the terms of the cost at an
    instant; G stacks the goal rows and the terms of the cost at the last instant. H is the upper triangle of
    the second derivatives of weights . F.

    Attributes:
        call: Evaluates a function by name for instants z (nz, count), one per column: ``values`` (F),
            ``jacobian`` (nonzero entries of dF/dz) and ``hessian`` (nonzero entries of H, with the weights as
            second argument); ``goal_values``, ``goal_jacobian`` and ``goal_hessian`` for G.
        backend: ``compiled`` or ``interpreted``.
        jacobian, hessian, goal_jacobian, goal_hessian: Rows and columns of the nonzero entries.
    """

    call: Callable[..., Array]
    backend: str
    jacobian: Pattern
    hessian: Pattern
    goal_jacobian: Pattern
    goal_hessian: Pattern


def build_instants(problem: PlanningProblem, backend: str = "auto") -> InstantFunctions:
    """Functions of a problem.

    Args:
        problem: Problem whose instants are evaluated.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Raises:
        CompileError: If ``compiled`` is requested and there is no compiler.
    """
    return _instants(problem, _rows(problem), backend)


def extended(
    instants: InstantFunctions, problem: PlanningProblem, rows: Sequence[BoundedRow]
) -> InstantFunctions:
    """Functions of a problem with further rows at the end of its path; only the new rows are built.

    Args:
        instants, problem: Functions, and their problem.
        rows: Rows added to its path.
    """
    expression = ca.densify(ca.vertcat(*(row.value for row in rows)))
    added = _instants(problem, {"": (expression, implicit_in(rows))}, instants.backend)
    first = problem.stage.rate.numel() + problem.stage.balance.numel() + len(problem.path)
    count = len(rows)

    def call(name: str, *arguments: Array) -> Array:
        """Values of both functions, the added rows after the path's."""
        if name.startswith("goal_"):
            return instants.call(name, *arguments)
        if name == "hessian":
            z, weights = arguments
            path_weights = np.delete(weights, slice(first, first + count), axis=0)
            both = instants.call(name, z, path_weights), added.call(name, z, weights[first : first + count])
            return np.vstack(both)
        one, other = instants.call(name, *arguments), added.call(name, *arguments)
        return np.vstack([one[:first], other, one[first:]] if name == "values" else [one, other])

    (rows_of, columns), (added_rows, at) = instants.jacobian, added.jacobian
    moved = np.where(rows_of < first, rows_of, rows_of + count)
    jacobian = np.concatenate([moved, first + added_rows]), np.concatenate([columns, at])
    hessian = tuple(np.concatenate(both) for both in zip(instants.hessian, added.hessian, strict=True))
    return dataclasses.replace(instants, call=call, jacobian=jacobian, hessian=(hessian[0], hessian[1]))


def with_values_of(instants: InstantFunctions, problem: PlanningProblem) -> InstantFunctions:
    """Functions with the values of a problem that has other numbers, interpreted and without derivatives."""
    values = _instants(problem, _rows(problem), "interpreted", derivatives=False)
    return dataclasses.replace(instants, call=values.call, backend="interpreted")


Parts = tuple[ca.SX, list[Implicit]]
"""Rows as one expression, and the inner iterations on which they depend."""


def _rows(problem: PlanningProblem) -> dict[str, Parts]:
    """F of one instant, and the goal's rows, by the prefix of their functions' names."""
    stage = problem.stage
    parts = {
        "": (ca.vertcat(stage.rate, stage.balance), problem.path, ca.vertcat(*problem.terms.values())),
        "goal_": (ca.SX(0, 1), problem.goal, ca.vertcat(ca.SX(0, 1), *problem.ends.values())),
    }
    return {
        prefix: (
            ca.densify(ca.vertcat(before, *(row.value for row in rows), behind)),
            implicit_in(rows),
        )
        for prefix, (before, rows, behind) in parts.items()
    }


def _instants(
    problem: PlanningProblem, rows: Mapping[str, Parts], backend: str, *, derivatives: bool = True
) -> InstantFunctions:
    """Functions of rows of an instant; see :meth:`PlanningProblem.arguments`."""
    z, constant = problem.stage.z, problem.stage.inertia
    # Sharing common subexpressions of derivatives saves 5 % of their evaluation, but takes most of the time
    # in which they are built. For interpreted problems only the values share theirs.
    functions, patterns, share = dict[str, ca.Function](), list[Pattern](), backend != "interpreted"
    for prefix, (expression, iterated) in rows.items():
        symbols = symbols_of(iterated) if iterated else None
        if derivatives:
            derivative_functions, where = derived(
                z, expression, prefix, symbols, constant=constant, share=share
            )
            functions |= derivative_functions
            patterns += where
        else:
            functions[f"{prefix}values"] = _function(
                f"{prefix}values", _inputs(z, symbols, constant), expression
            )
        if iterated:
            inputs = ca.vertcat(*(one.arguments for one in iterated))
            functions[f"{prefix}given"] = _function(f"{prefix}given", _inputs(z, None, constant), inputs)
            functions |= functions_of(iterated)
    # Where shapes are apart, steps of the ascent replace the fixed iteration, whose code is several times as
    # long as all other functions together.
    rare = {
        one.function.name()
        for _, iterated in rows.values()
        for one in iterated
        if one.ascent is not None and one.function is not None
    }
    call, used = _caller(functions, backend, rare)
    none = (np.empty(0, dtype=np.int64),) * 2
    # results of inner iterations are cached
    implicit = {
        f"{prefix}{name}": (prefix, iterated) for prefix, (_, iterated) in rows.items() for name in NAMES
    }
    cache: dict[str, tuple[bytes, Array]] = {}

    def called(name: str, z: Array, *others: Array) -> Array:
        """Values (n, count) of a function at columns of instants, with its other arguments."""
        prefix, iterated = implicit[name]
        if not iterated:
            return call(name, z, *others)
        key = z.tobytes()
        if prefix not in cache or cache[prefix][0] != key:
            near = cache[prefix][1] if prefix in cache else None  # of an iterate close by, mostly
            cache[prefix] = key, implicit_values(iterated, call(f"{prefix}given", z), call, near)
        return call(name, z, cache[prefix][1], *others)

    return InstantFunctions(called, used, *(patterns + [none] * (4 - len(patterns))))


def derived(
    z: ca.SX,
    rows: ca.SX,
    prefix: str,
    held: ca.SX | None = None,
    *,
    constant: ca.SX | None = None,
    share: bool = True,
) -> tuple[dict[str, ca.Function], list[Pattern]]:
    """Functions ``{prefix}values``, ``{prefix}jacobian`` and ``{prefix}hessian`` of rows, and their sparsity.

    Their inputs are (z; constant) as one vector, then ``held`` if there is any, and for the second
    derivatives the weights of the rows.

    Args:
        z: Variables of the derivatives (nz, 1).
        rows: Values F (n, 1).
        prefix: First part of the functions' names.
        held: Symbols held constant in the derivatives: results of inner iterations.
        constant: Symbols stacked below z, which the derivatives also hold constant.
        share: Whether common subexpressions of the derivatives are eliminated; those of the values are
            always.

    Returns:
        Functions by name, and the sparsity of the Jacobian and of the upper triangle of the Hessian of
        weights . F.
    """
    weights, inputs, rows = ca.SX.sym("weights", rows.numel()), _inputs(z, held, constant), ca.cse(rows)
    jacobian = ca.jacobian(rows, z)
    hessian = ca.triu(ca.hessian(ca.dot(weights, rows), z)[0])
    functions = {
        f"{prefix}values": _function(f"{prefix}values", inputs, rows),
        f"{prefix}jacobian": _function(f"{prefix}jacobian", inputs, _entries(jacobian), share=share),
        f"{prefix}hessian": _function(f"{prefix}hessian", [*inputs, weights], _entries(hessian), share=share),
    }
    return functions, [_pattern(jacobian), _pattern(hessian)]


def _inputs(z: ca.SX, held: ca.SX | None, constant: ca.SX | None) -> list[ca.SX]:
    """Inputs of a function of rows: (z; constant) as one vector, then ``held`` if there is any."""
    first = z if constant is None else ca.vertcat(z, constant)
    return [first] if held is None else [first, held]


def _function(name: str, inputs: list[ca.SX], output: ca.SX, *, share: bool = True) -> ca.Function:
    return ca.Function(name, inputs, [ca.densify(output)], {"cse": share})


def _entries(matrix: ca.SX) -> ca.SX:
    """Entries of a sparse matrix as a dense column."""
    return ca.reshape(matrix.nz[:], matrix.nnz(), 1)  # of a single row they come as a row


def _pattern(matrix: ca.SX) -> Pattern:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _caller(
    functions: Mapping[str, ca.Function], backend: str, rare: Collection[str] = ()
) -> tuple[Callable[..., Array], str]:
    """Evaluator of functions for columns (n, N), and its backend; ``rare`` ones are always interpreted."""
    mapped: dict[tuple[str, int], ca.Function] = {}

    def in_turn(name: str, *given: Array) -> Array:
        """Values of an interpreted function, column by column."""
        count = given[0].shape[1]
        if (name, count) not in mapped:
            mapped[name, count] = functions[name].map(count)
        return np.array(mapped[name, count](*given).full()).reshape(-1, count)

    toolchain = None if backend == "interpreted" else find_toolchain()
    if toolchain is not None or backend == "compiled":
        try:
            lanes = 1 if toolchain is None else toolchain.lanes
            used = {name: f for name, f in functions.items() if f.numel_out(0) and name not in rare}
            library = compile_functions(used, lanes=lanes, toolchain=toolchain)
        except CompileError:
            if backend == "compiled":
                raise
        else:

            def in_lanes(name: str, *given: Array) -> Array:
                """Values (n, count) of a function at columns."""
                if name in rare:
                    return in_turn(name, *given)
                if not (given[0].shape[1] and functions[name].numel_out(0)):
                    return np.empty((functions[name].numel_out(0), given[0].shape[1]))
                return library.columns(name, *given)

            return in_lanes, "compiled"
    return in_turn, "interpreted"
