"""Compiled CasADi functions called with NumPy arrays at little overhead.

:mod:`spacerobot.compiled.numeric_function` is the interpreted equivalent, which needs no compiler.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.compiled.library import compile_functions


def numpy_function(function: ca.Function) -> Callable[..., Array | tuple[Array, ...]]:
    """Compile a CasADi function, or load it from the cache, to be called with NumPy arrays.

    The returned function copies arguments and results through buffers of its own. It is therefore not
    thread-safe: build one for each thread.

    Args:
        function: SX function with dense inputs and outputs and no free variables.

    Returns:
        callable: Function of one argument for each input, (n,) or a number for every entry; matrices are
            stacked column by column. It returns a tuple of new arrays (n,), one for each output, or the
            array itself if there is one output. It raises a ``ValueError`` if the number of arguments or
            the length of one is wrong.

    Raises:
        CompileError: There is no compiler, or it rejects the function.
    """
    library = compile_functions({"f": function})
    call = library.entry("call_f")
    inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
    outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    arguments = (ctypes.c_void_p * len(inputs))(*[array.ctypes.data for array in inputs])
    results = (ctypes.c_void_p * len(outputs))(*[array.ctypes.data for array in outputs])

    def evaluate(*values: npt.ArrayLike) -> Array | tuple[Array, ...]:
        """Evaluate the function."""
        for place, value in zip(inputs, values, strict=True):
            place[:] = value
        call(arguments, results)
        return outputs[0].copy() if len(outputs) == 1 else tuple(array.copy() for array in outputs)

    return evaluate
