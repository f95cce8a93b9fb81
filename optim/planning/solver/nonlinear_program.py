"""Interface of a nonlinear program to its solver."""

from __future__ import annotations

from typing import Protocol

from scipy import sparse

from spacerobot.common.arrays import Array


class NonlinearProgram(Protocol):
    """Interface of a nonlinear program to its solver."""

    size: int
    rows: int

    @property
    def jacobian_pattern(self) -> sparse.csc_matrix:
        """Sparsity of the constraints' first derivatives (rows, size)."""

    @property
    def hessian_pattern(self) -> sparse.csc_matrix:
        """Sparsity of the upper triangle of the Lagrangian's second derivatives (size, size)."""

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns (size,) each."""

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the constraints (rows,) each."""

    def objective(self, w: Array) -> float:
        """Cost."""

    def gradient(self, w: Array) -> Array:
        """Gradient of the cost (size,)."""

    def constraints(self, w: Array) -> Array:
        """Values of all constraints (rows,)."""

    def jacobian(self, w: Array) -> Array:
        """Nonzero entries of the Jacobian of the constraints."""

    def hessian(self, w: Array, factor: float, multipliers: Array) -> Array:
        """Nonzero entries of the Lagrangian's Hessian, upper triangle."""
