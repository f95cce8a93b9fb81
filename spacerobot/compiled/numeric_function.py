"""Interpreted CasADi functions of NumPy arrays, without CasADi's conversion of each argument and result.

:mod:`spacerobot.compiled.numpy_function` has compiled ones, which need a compiler.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array


class NumericFunction:
    """Function of NumPy arrays that CasADi's virtual machine evaluates.

    CasADi makes a matrix of its own of every argument and result, which takes 40 us a call where a small
    function itself takes 1 us. Here they pass through buffers that belong to this object: threads must not
    share one.

    Args:
        function: Function with dense inputs and outputs.

    Raises:
        ValueError: An input or output is sparse.
    """

    def __init__(self, function: ca.Function) -> None:
        inputs, outputs = range(function.n_in()), range(function.n_out())
        patterns = [*map(function.sparsity_in, inputs), *map(function.sparsity_out, outputs)]
        if not all(pattern.is_dense() for pattern in patterns):
            raise ValueError(f"function '{function.name()}' has sparse inputs or outputs")
        self._buffer: Any  # must outlive the calls
        self._buffer, self._evaluate = function.buffer()
        self._given = [np.zeros(function.numel_in(i)) for i in inputs]
        results = [np.zeros(function.numel_out(i)) for i in outputs]
        for give, arrays in ((self._buffer.set_arg, self._given), (self._buffer.set_res, results)):
            for i, array in enumerate(arrays):
                if array.size:
                    give(i, memoryview(array))  # type: ignore[arg-type]
        # CasADi stores a matrix column by column
        sizes = [function.size_out(i) for i in outputs]
        self._found = [
            result.reshape(columns, rows).T for result, (rows, columns) in zip(results, sizes, strict=True)
        ]

    def __call__(self, *arguments: npt.ArrayLike) -> list[Array]:
        """Evaluate.

        Args:
            arguments: One for each input: shape (n,), or a number for every entry; a matrix column by column.

        Returns:
            list of arrays: New arrays, one for each output: shape (n,) of a column, (rows, columns) of
                another matrix.

        Raises:
            ValueError: The number of arguments, or the length of one, is wrong.
        """
        return [matrix[:, 0] if matrix.shape[1] == 1 else matrix for matrix in self.matrices(*arguments)]

    def matrices(self, *arguments: npt.ArrayLike) -> list[Array]:
        """Evaluate as :meth:`__call__`, each output of shape (rows, columns)."""
        for place, argument in zip(self._given, arguments, strict=True):
            place[:] = argument
        self._evaluate()
        return [matrix.copy() for matrix in self._found]
