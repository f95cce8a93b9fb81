"""Interpreted CasADi functions called with NumPy arrays, without CasADi's conversion of arguments and
results.

:mod:`spacerobot.compiled.numpy_function` is the compiled equivalent.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array


class NumericFunction:
    """Function of NumPy arrays that CasADi's virtual machine evaluates.

    CasADi converts every argument and result to its own matrices, which takes 40 us in each call, while a
    small function takes 1 us. This class passes them through buffers of its own, so that threads must not
    share an object.

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
        self._arguments = [np.zeros(function.numel_in(i)) for i in inputs]
        results = [np.zeros(function.numel_out(i)) for i in outputs]
        for attach, arrays in ((self._buffer.set_arg, self._arguments), (self._buffer.set_res, results)):
            for i, array in enumerate(arrays):
                if array.size:
                    attach(i, memoryview(array))  # type: ignore[arg-type]
        # CasADi stores a matrix column by column
        sizes = [function.size_out(i) for i in outputs]
        self._results = [
            result.reshape(columns, rows).T for result, (rows, columns) in zip(results, sizes, strict=True)
        ]

    def __call__(self, *arguments: npt.ArrayLike) -> list[Array]:
        """Evaluate the function.

        Args:
            arguments: One argument for each input, (n,) or a number for every entry; matrices are stacked
                column by column.

        Returns:
            list of arrays: New arrays, one for each output: (n,) for a column, (rows, columns) for other
                matrices.

        Raises:
            ValueError: The number of arguments, or the length of one, is wrong.
        """
        return [matrix[:, 0] if matrix.shape[1] == 1 else matrix for matrix in self.matrices(*arguments)]

    def matrices(self, *arguments: npt.ArrayLike) -> list[Array]:
        """Evaluate the function as :meth:`__call__`, with every output as a matrix (rows, columns)."""
        for place, argument in zip(self._arguments, arguments, strict=True):
            place[:] = argument
        self._evaluate()
        return [matrix.copy() for matrix in self._results]
