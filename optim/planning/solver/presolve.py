"""Presolve: elimination of unknowns that the equations determine by themselves.

An example is the motion of a free target when the duration is fixed. Such unknowns are solved for beforehand
and leave the program together with their equations. The multipliers of these equations follow from the
solution.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import splu

from optim.planning.solver.nonlinear_program import NonlinearProgram
from spacerobot.common.arrays import Array

Places = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

STEPS = 12
"""Maximum number of steps of Newton's method."""
EXACT = 1e-11
"""Maximum residual of an equation, and maximum violation of a limit, that count as zero."""
SINGULAR = 1e-12
"""Minimum pivot, relative to the largest, of equations that determine their unknowns."""


class PresolvedProgram:
    """A program without its determined unknowns, which is a :class:`NonlinearProgram` too.

    Args:
        program: Program with all unknowns.
        first: Initial values of all unknowns (size,).

    Attributes:
        free, held: Indices of the remaining unknowns and constraints of the program.
        size, rows: Number of remaining unknowns and of remaining constraints.
    """

    def __init__(self, program: NonlinearProgram, first: Array) -> None:
        self.program = program
        (low, high), (least, greatest) = program.bounds(), program.limits()
        self._equations, self._known = determined(program.jacobian_pattern, least == greatest, low < high)
        self._w = np.clip(first, low, high)
        if not self._found(least) or (np.maximum(low - self._w, self._w - high) > EXACT).any():
            self._equations = self._known = np.empty(0, dtype=np.int64)
            self._w = np.clip(first, low, high)
        free, held = np.ones(program.size, dtype=bool), np.ones(program.rows, dtype=bool)
        free[self._known], held[self._equations] = False, False
        self.free, self.held = np.flatnonzero(free), np.flatnonzero(held)
        self.size, self.rows = len(self.free), len(self.held)
        self._slopes, self.jacobian_pattern = _part(program.jacobian_pattern, held, free)
        self._bends, self.hessian_pattern = _part(program.hessian_pattern, free, free)

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns (size,) each."""
        low, high = self.program.bounds()
        return low[self.free], high[self.free]

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the constraints (rows,) each."""
        least, greatest = self.program.limits()
        return least[self.held], greatest[self.held]

    def objective(self, w: Array) -> float:
        """Cost."""
        return self.program.objective(self.unknowns(w))

    def gradient(self, w: Array) -> Array:
        """Gradient of the cost (size,)."""
        return self.program.gradient(self.unknowns(w))[self.free]

    def constraints(self, w: Array) -> Array:
        """Values of the remaining constraints (rows,)."""
        return self.program.constraints(self.unknowns(w))[self.held]

    def jacobian(self, w: Array) -> Array:
        """Nonzero entries of the Jacobian of the remaining constraints."""
        return self.program.jacobian(self.unknowns(w))[self._slopes]

    def hessian(self, w: Array, factor: float, multipliers: Array) -> Array:
        """Entries of the second derivatives of factor times cost plus multipliers times constraints."""
        every = _spread(multipliers, self.held, self.program.rows)
        return self.program.hessian(self.unknowns(w), factor, every)[self._bends]

    def unknowns(self, w: Array) -> Array:
        """Values of all unknowns of the program, from the remaining ones."""
        out = self._w.copy()
        out[self.free] = w
        return out

    def multipliers(self, w: Array, reduced: Array) -> Array:
        """Multipliers of all constraints; the Lagrangian is stationary in the eliminated unknowns too."""
        program, every = self.program, _spread(reduced, self.held, self.program.rows)
        if len(self._known):
            x = self.unknowns(w)
            pull = program.gradient(x) + _matrix(program.jacobian_pattern, program.jacobian(x)).T @ every
            every[self._equations] = splu(self._square(x)).solve(-pull[self._known], trans="T")
        return every

    def spread(self, values: Array) -> Array:
        """Vector of all unknowns with the remaining ones' values, and zeros elsewhere."""
        return _spread(values, self.free, self.program.size)

    def _found(self, right_side: Array) -> bool:
        """Solve for the determined unknowns by Newton's method; returns whether it converged."""
        for _ in range(STEPS if len(self._known) else 0):
            off = (self.program.constraints(self._w) - right_side)[self._equations]
            if not np.isfinite(off).all():
                return False
            try:
                factors = splu(self._square(self._w))
            except RuntimeError:  # singular
                return False
            # The sparsity alone may suggest that equations determine an unknown that they do not: the rest at
            # the end of a body without actuation does not determine a duration.
            pivots = np.abs(factors.U.diagonal())
            if pivots.min() < SINGULAR * pivots.max():
                return False
            if np.abs(off).max() < EXACT:
                return True
            self._w[self._known] -= factors.solve(off)
        return False

    def _square(self, w: Array) -> sparse.csc_matrix:
        """Jacobian of the eliminated equations by the determined unknowns."""
        slopes = _matrix(self.program.jacobian_pattern, self.program.jacobian(w))
        return slopes[:, self._known][self._equations].tocsc()


def determined(pattern: sparse.csc_matrix, equal: Mask, free: Mask) -> tuple[Places, Places]:
    """Largest structurally square set of equations and the unknowns that they determine.

    It is the square part of the Dulmage-Mendelsohn decomposition: in a maximum matching, no alternating path
    leads to it from an unmatched unknown or an unmatched equation. Equations that depend on unknowns of the
    overdetermined part, also by way of others' unknowns, are left out too.

    Args:
        pattern: Sparsity of the constraints' first derivatives (constraints, unknowns).
        equal, free: Masks of the constraints that are equations, and of the unknowns that are not fixed.

    Returns:
        tuple: Equations, and the unknown that each is matched with.
    """
    rows, columns = np.flatnonzero(equal), np.flatnonzero(free)
    part = _matrix(pattern, np.ones(pattern.nnz))[:, columns][rows].tocsc()
    where = ca.Sparsity(len(rows), len(columns), part.indptr.tolist(), part.indices.tolist())
    # CasADi decomposes the transpose: equations and unknowns are sorted into the overdetermined part, the
    # square one, and the underdetermined one.
    _, by_row, by_column, _, _, row_ends, column_ends = where.btf()
    squares = np.array(by_row[row_ends[2] : row_ends[3]], dtype=np.int64)
    square_unknowns = np.array(by_column[column_ends[1] : column_ends[2]], dtype=np.int64)
    pairs, over = part[squares], by_column[: column_ends[1]]
    graph = pairs[:, square_unknowns].T
    begin = pairs[:, over].sum(axis=1)
    first = sparse.csr_matrix(np.ravel(begin))
    bipartite = sparse.bmat([[None, first], [sparse.csr_matrix((graph.shape[0], 1)), graph]], format="csr")
    left_out = np.asarray(breadth_first_order(bipartite, 0, return_predecessors=False))[1:] - 1
    match_indices = np.setdiff1d(np.argsort(square_unknowns), left_out, assume_unique=True)
    return rows[squares[match_indices]], columns[square_unknowns[match_indices]]


def _part(pattern: sparse.csc_matrix, rows: Mask, columns: Mask) -> tuple[Places, sparse.csc_matrix]:
    """Submatrix of a pattern, and the indices of its entries in the whole pattern."""
    count = np.arange(1, pattern.nnz + 1)  # no zero, which might be dropped
    part = _matrix(pattern, count)[:, columns][rows].tocsc()
    part.sort_indices()
    return part.data - 1, part


def _matrix(pattern: sparse.csc_matrix, entries: Array | Places) -> sparse.csc_matrix:
    return sparse.csc_matrix((entries, pattern.indices, pattern.indptr), shape=pattern.shape)


def _spread(values: Array, places: Places, size: int) -> Array:
    out = np.zeros(size)
    out[places] = values
    return out
