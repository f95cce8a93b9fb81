"""Derivatives along a direction, carried as imaginary parts (complex-step method).

With ``z = x + i h dx`` and h so small that its square is negligible against one, an analytic computation
gives ``f(z) = f(x) + i h df`` without subtracting close numbers: exact to rounding (W. Squire, G. Trapp, SIAM
Review 40(1), 1998). CasADi's functions take real numbers and contribute their own exact derivatives.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array

STEP = 1e-30
"""Step h of the imaginary parts."""


def derivative(value: Any) -> Any:
    """Derivative carried by a number or an array."""
    return np.imag(value) / STEP


def evaluate(function: ca.Function, *arguments: Any) -> list[Array]:
    """Results of a CasADi function as arrays (n, m), with derivatives if arguments carry any.

    Args:
        function: The function.
        *arguments: Numbers and arrays, real or with derivatives.
    """
    values = [np.real(argument) for argument in arguments]
    values_out = function.call(values)
    if not any(np.iscomplexobj(argument) for argument in arguments):
        return [part.full() for part in values_out]
    slopes = function.forward(1).call([*values, *values_out, *map(derivative, arguments)])
    return [part.full() + 1j * STEP * slope.full() for part, slope in zip(values_out, slopes, strict=True)]
