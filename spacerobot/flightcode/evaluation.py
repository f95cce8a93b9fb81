r"""Evaluation of functions instruction by instruction, and their sensitivity to the mathematical library.

Two libraries whose functions err by at most one unit in the last place differ by at most
$2 \varepsilon |y_k|$ in the call $y_k$. To first order a result $r$ of a function then differs by at most
$2 \varepsilon \sum_k |y_k\, \partial r / \partial y_k|$.

Operations after the calls also round differently if their arguments change. Evaluations in which each call is
changed by one unit, up or down at random, measure this effect. The bound of a row is ``MARGIN`` times the
largest of both and one, in units of the rounding error of the row's largest result. It is zero if no result
depends on a call: such rows must agree to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.flightcode.c_functions import LIBM, count_operations

MARGIN = 4.0
"""Factor of the bound for what eight random changes do not show."""

SHIFT = 2.0**-30
"""Relative change of one call by which its derivative is found: its square is lost in rounding."""

PATTERNS = 8
"""Number of random changes of all calls by one unit in the last place."""

CHUNK = 100
"""Rows that are evaluated together."""


def library_bounds(function: ca.Function, arguments: Array, kind: type[np.floating]) -> Array:
    """Bounds of differences by another mathematical library.

    Args:
        function: Function of SX expressions.
        arguments: All its arguments, one row a call (n, m).
        kind: Type of numbers.

    Returns:
        numpy.ndarray: For each row, in roundings of its largest result (n,).
    """
    calls = sum(count_operations(function).libm.values())
    if not calls:
        return np.zeros(len(arguments))
    chunks = [arguments[i : i + CHUNK] for i in range(0, len(arguments), CHUNK)]
    return np.concatenate([_chunk_bounds(function, chunk, kind, calls) for chunk in chunks])


def _chunk_bounds(function: ca.Function, rows: Array, kind: type[np.floating], calls: int) -> Array:
    """Bounds of some rows; one change of the calls after the other, each of all rows."""
    generator, epsilon = np.random.default_rng(0), float(np.finfo(kind).eps)
    shifts = np.vstack([np.zeros(calls), SHIFT * np.eye(calls)])
    # relative to a value a unit in the last place is at most epsilon
    units = np.vstack([np.zeros(calls), epsilon * generator.choice([-1.0, 1.0], size=(PATTERNS, calls))])

    def differences(changes: Array, number: type[np.floating]) -> Array:
        """Absolute changes of all results (changes, n, k)."""
        arguments = np.tile(rows, (len(changes), 1))
        factors = 1 + np.repeat(changes, len(rows), axis=0)
        results = evaluate_rows(function, arguments, number, factors).astype(float)
        results = results.reshape(len(changes), len(rows), -1)
        with np.errstate(invalid="ignore"):
            changed: Array = np.abs(results[1:] - results[0])
        return np.where(np.isfinite(changed), changed, 0.0)

    scale = np.abs(evaluate_rows(function, rows, kind).astype(float))
    largest = np.where(np.isfinite(scale), scale, 0.0).max(axis=1)
    first_order = 2 * differences(shifts, np.float64).sum(axis=0).max(axis=1) / SHIFT * epsilon
    measured = differences(units, kind).max(axis=(0, 2))
    change = np.maximum(first_order, measured)
    bound: Array = MARGIN * change / (epsilon * np.where(largest > 0, largest, 1))
    return np.where(change > 0, 1 + bound, 0.0)


def evaluate_rows(
    function: ca.Function, arguments: Array, kind: type[np.floating], factors: Array | None = None
) -> Array:
    """Evaluate a function's instructions in a given precision, for many rows of arguments at once.

    Args:
        function: Function of SX expressions.
        arguments: All its arguments, one row a call (n, m).
        kind: Type of every intermediate number.
        factors: Factors of the results of the library's functions, one column a call (n, calls).

    Returns:
        numpy.ndarray: All its results (n, k).
    """
    firsts = np.cumsum([0, *(function.numel_in(i) for i in range(function.n_in()))])
    ends = np.cumsum([0, *(function.numel_out(i) for i in range(function.n_out()))])
    numbers = arguments.astype(kind)
    results = np.zeros((len(arguments), int(ends[-1])), kind)
    work: dict[int, npt.NDArray[np.floating]] = {}
    calls = 0
    with np.errstate(all="ignore"):
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_CONST:
                work[outputs[0]] = np.full(len(numbers), function.instruction_constant(k), kind)
            elif operation == ca.OP_INPUT:
                work[outputs[0]] = numbers[:, firsts[inputs[0]] + inputs[1]]
            elif operation == ca.OP_OUTPUT:
                results[:, ends[outputs[0]] + outputs[1]] = work[inputs[0]]
            else:
                work[outputs[0]] = _OPERATIONS[operation](*(work[i] for i in inputs)).astype(kind)
                if operation in LIBM and factors is not None:
                    work[outputs[0]] = (work[outputs[0]] * factors[:, calls]).astype(kind)
                    calls += 1
    return results


_OPERATIONS: Mapping[int, Callable[..., npt.NDArray[np.generic]]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
    ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_FMOD: np.fmod,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_IF_ELSE_ZERO: lambda a, b: np.where(a != 0, b, 0),
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_HYPOT: np.hypot,
}
