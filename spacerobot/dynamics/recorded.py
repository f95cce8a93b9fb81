"""Functions of expressions whose operations are recorded once and replayed by CasADi.

An operator on expressions takes 15 us in Python, nearly all of it to determine the types of its operands; a
replayed operator takes 0.1 us. Operators used to take most of the time to build a closed loop.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar, cast

import casadi as ca

Result = TypeVar("Result", bound="ca.SX | tuple[ca.SX, ...]")


def recorded(*shapes: tuple[int, int]) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorator that records a function of matrices once and replays the same operations in less time.

    The function must not depend on the structure of its arguments, since it is called with dense symbols.
    Arguments may be sparse; results that are zero because of that are structurally zero.

    Args:
        shapes: Rows and columns of the positional arguments. Each set of keyword arguments has its own
            recording.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        """Replacement of the function; its first call records the operations."""

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
