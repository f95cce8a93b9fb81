"""Functions of expressions whose operations are recorded once and replayed by CasADi.

An operator on expressions takes 15 us in Python, nearly all of it to find out what its operands are, a
replayed one 0.1 us. Most of the time to build a closed loop went there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar, cast

import casadi as ca

Result = TypeVar("Result", bound="ca.SX | tuple[ca.SX, ...]")


def recorded(*shapes: tuple[int, int]) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorator of a function of matrices: the same expressions, operation by operation, in less time.

    The function must not look at the structure of its arguments: it is called with symbols alone. Arguments
    may be sparse, and what is zero then is structurally zero in the results.

    Args:
        shapes: Rows and columns of its positional arguments; those by keyword choose among several
            recordings.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        """The function, recorded when it is called first."""

        @functools.cache
        def record(**fixed: object) -> ca.Function:
            symbols = [ca.SX.sym("x", *shape) for shape in shapes]
            outputs = function(*symbols, **fixed)
            return ca.Function("recording", symbols, outputs if isinstance(outputs, tuple) else (outputs,))

        @functools.wraps(function)
        def replay(*arguments: ca.SX, **fixed: object) -> Result:
            outputs = record(**fixed)(*arguments)
            several = isinstance(outputs, tuple)
            return cast(Result, tuple(map(ca.sparsify, outputs)) if several else ca.sparsify(outputs))

        return replay

    return decorate
