"""Elastic form of a program: its goals and path constraints may be violated, at a cost.

    min  e f(w)/f0 + sum(p + n)    s.t.  c(w) = 0,  l <= g(w) - p + n <= u,  p, n >= 0,  limits of w

g are the soft constraints, c all others, f0 the size of the cost. The elastic program is feasible whenever c
is. If the program itself is feasible and e is small enough, p = n = 0 and w solves it, because the l1 penalty
is exact. Otherwise p + n is the smallest violation. The multipliers of the active hard limits then show which
of them prevent a smaller one: raising such a limit by d lowers the violation by d times its multiplier.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from optim.planning.solver.nonlinear_program import NonlinearProgram
from spacerobot.common.arrays import Array

COST = 1e-4
"""Weight e of the cost: far below the inverse of the multipliers, and large enough for a unique minimum."""


class ElasticProgram:
    """An elastic program, which is a :class:`NonlinearProgram` too.

    Args:
        program: Program with hard constraints only.
        soft: Indices of the constraints that may be violated (m,).
        scale: Size f0 of the cost.

    Attributes:
        size, rows: Number of unknowns: those of the program, then p (m,) and n (m,); and of constraints.
    """

    def __init__(self, program: NonlinearProgram, soft: npt.NDArray[np.int64], scale: float) -> None:
        self.program, self.soft, self._weight = program, soft, COST / scale
        many = len(soft)
        self.size, self.rows = program.size + 2 * many, program.rows
        ones = sparse.csc_matrix((np.ones(many), soft, np.arange(many + 1)), shape=(self.rows, many))
        self.jacobian_pattern = _beside(program.jacobian_pattern, ones, ones)
        none = sparse.csc_matrix((self.size, 2 * many))
        wide = program.hessian_pattern.copy()
        wide.resize((self.size, program.size))
        self.hessian_pattern = _beside(wide, none)

    def started(self, w: Array) -> Array:
        """Initial unknowns from those of the program, with slack on violated rows only."""
        g, (least, greatest) = self.program.constraints(w)[self.soft], self.program.limits()
        over = np.maximum(g - greatest[self.soft], 0.0), np.maximum(least[self.soft] - g, 0.0)
        return np.concatenate([w, *over])

    def violation(self, w: Array) -> float:
        """Maximum violation of a soft constraint."""
        return float(np.max(w[self.program.size :], initial=0.0))

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns."""
        low, high = self.program.bounds()
        slack = np.zeros(2 * len(self.soft))
        return np.append(low, slack), np.append(high, slack + np.inf)

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the constraints."""
        return self.program.limits()

    def objective(self, w: Array) -> float:
        """Violation plus the weighted cost."""
        size = self.program.size
        return self._weight * self.program.objective(w[:size]) + float(w[size:].sum())

    def gradient(self, w: Array) -> Array:
        """Gradient of the objective (size,)."""
        size = self.program.size
        return np.append(self._weight * self.program.gradient(w[:size]), np.ones(2 * len(self.soft)))

    def constraints(self, w: Array) -> Array:
        """Values of all constraints (rows,)."""
        over, under = np.split(w[self.program.size :], 2)
        g = self.program.constraints(w[: self.program.size])
        g[self.soft] += under - over
        return g

    def jacobian(self, w: Array) -> Array:
        """Entries of the constraints' first derivatives."""
        one = np.ones(len(self.soft))
        return np.concatenate([self.program.jacobian(w[: self.program.size]), -one, one])

    def hessian(self, w: Array, factor: float, multipliers: Array) -> Array:
        """Entries of the upper triangle of the Lagrangian's second derivatives."""
        return self.program.hessian(w[: self.program.size], self._weight * factor, multipliers)


def _beside(*parts: sparse.csc_matrix) -> sparse.csc_matrix:
    """Matrices concatenated by columns, with the order of their entries kept."""
    ends = np.cumsum([0, *(part.nnz for part in parts)])
    starts = [part.indptr[:-1] + end for part, end in zip(parts, ends, strict=False)]
    data, rows = (np.concatenate([getattr(part, key) for part in parts]) for key in ("data", "indices"))
    shape = (parts[0].shape[0], sum(part.shape[1] for part in parts))
    return sparse.csc_matrix((data, rows, np.append(np.concatenate(starts), ends[-1])), shape=shape)
