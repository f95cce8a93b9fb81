"""A compiled function that takes and gives NumPy arrays, with as little in between as Python allows.

:mod:`spacerobot.numeric_function` has interpreted ones, which need no compiler.
"""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.arrays import Array
from spacerobot.compiled.library import compile_functions


class NumpyFunction:
    """Compiled CasADi function of NumPy arrays.

    Its arguments and results pass through arrays of its own, so that each thread needs one of its own.
    """

    def __init__(self, function: ca.Function) -> None:
        self._library = compile_functions({"f": function})
        self._call = self._library.entry("call_f")
        self._given = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self._found = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        self._arguments = (ctypes.c_void_p * len(self._given))(*[a.ctypes.data for a in self._given])
        self._results = (ctypes.c_void_p * len(self._found))(*[a.ctypes.data for a in self._found])

    def __call__(self, *arguments: npt.ArrayLike) -> Array | tuple[Array, ...]:
        """Evaluate.

        Parameters
        ----------
        arguments
            One for each input: shape (n,), or a number for every entry; a matrix column by column.

        Returns
        -------
        array, or tuple of arrays
            New arrays of shape (n,), one for each output; alone where there is only one.

        Raises
        ------
        ValueError
            The number of arguments, or the length of one, is wrong.
        """
        for place, argument in zip(self._given, arguments, strict=True):
            place[:] = argument
        self._call(self._arguments, self._results)
        if len(self._found) == 1:
            return self._found[0].copy()
        return tuple(found.copy() for found in self._found)


def numpy_function(function: ca.Function) -> NumpyFunction:
    """Compile a CasADi function, or take it from the cache, to be called with NumPy arrays.

    Parameters
    ----------
    function
        SX function with dense inputs and outputs and no free variables.

    Raises
    ------
    CompileError
        There is no compiler, or it does not accept the function.
    """
    return NumpyFunction(function)
