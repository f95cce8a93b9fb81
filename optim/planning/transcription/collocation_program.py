"""Sparse nonlinear program of a planning problem on a mesh.

Unknowns are the instants at all points and the duration T. Interval n has the share h_n of the duration and
the points j = 0 .. s - 1. Its collocation equations are

    x_nj = x_n0 + T h_n sum_k A_jk x'_nk,    x = (q, v),  x' = (q'(z), a).

The other constraints are the equations of motion and the path constraints at every point, and the
goals at the last one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.instant_functions import InstantFunctions, Places
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from spacerobot.common.arrays import Array


@dataclass(frozen=True, eq=False)
class SparseSums:
    """Sums of sparse entries in any order, with several for one place, as a compressed sparse matrix.

    Attributes:
        matrix: Sparsity of the sum; its entries have no meaning.
        place: Index in the matrix's data of each input entry.
    """

    matrix: sparse.csc_matrix
    place: Places

    @classmethod
    def of(cls, groups: Sequence[tuple[Any, Any]], shape: tuple[int, int]) -> SparseSums:
        """Sums for groups of entries, each given by arrays of rows and columns."""
        rows, columns = (
            np.concatenate([np.asarray(group).ravel() for group in side]).astype(np.int64)
            for side in zip(*groups, strict=True)
        )
        keys, place = np.unique(columns * np.int64(shape[0]) + rows, return_inverse=True)
        own_rows, own_columns = keys % shape[0], keys // shape[0]
        starts = np.searchsorted(own_columns, np.arange(shape[1] + 1))
        matrix = sparse.csc_matrix((np.zeros(len(keys)), own_rows, starts), shape=shape)
        return cls(matrix, place)

    def entries(self, values: Array) -> Array:
        """Data of the matrix from input entries."""
        return np.asarray(np.bincount(self.place, weights=values, minlength=self.matrix.nnz), dtype=float)


class CollocationProgram:
    """A planning problem on a mesh.

    Args:
        problem: The problem.
        instants: Functions of the problem.
        lobatto, mesh: The collocation, and the mesh or its number of equal intervals.
    """

    def __init__(
        self, problem: PlanningProblem, instants: InstantFunctions, lobatto: Lobatto, mesh: int | Mesh
    ) -> None:
        self.problem, self.instants, self.lobatto = problem, instants, lobatto
        self.mesh = Mesh.of(mesh)
        self.intervals = intervals = self.mesh.intervals
        model = problem.stage.scene.model
        self.nq, self.nv, self.nz = model.nq, model.nv, problem.stage.z.numel()
        self.nx, self.inner = model.nq + model.nv, lobatto.points - 1
        self.points = intervals * self.inner + 1
        self.size = self.points * self.nz + 1
        self.ncost = self.nq + self.nv + len(problem.path)  # rows from here on are terms of the cost
        self.term_weights = np.array([problem.weights[name] for name in problem.terms])
        self.end_weights = np.array([problem.weights[name] for name in problem.ends])
        self._of = np.arange(intervals)[:, None] * self.inner + np.arange(
            lobatto.points
        )  # points by interval
        self.weights = lobatto.quadrature(self.mesh)
        self._parts = self.mesh.widths[:, None, None]  # h_n
        self.defects = intervals * self.inner * self.nx
        self.per_point = self.nv + len(problem.path)
        self.rows = self.defects + self.points * self.per_point + len(problem.goal)
        self._seen: tuple[bytes, dict[str, Array]] = (b"", {})
        # indices of the derivatives' entries, in the order in which `jacobian` and `hessian` return them
        rows, columns = instants.jacobian
        n, i, k = np.meshgrid(
            np.arange(self.intervals), np.arange(self.inner), np.arange(self.nx), indexing="ij"
        )
        defect = (n * self.inner + i) * self.nx + k
        blocks = [(defect, self._of[n, i + 1] * self.nz + k), (defect, self._of[n, 0] * self.nz + k)]
        moving = rows < self.nq
        blocks.append(self._by_point(defect, rows[moving], columns[moving]))
        velocity_rows = np.arange(self.nq, self.nx)
        blocks.append(self._by_point(defect, velocity_rows, self.nx + velocity_rows - self.nq))
        blocks.append((defect, np.full(defect.shape, self.size - 1)))
        inside = (rows >= self.nq) & (rows < self.ncost)
        point = np.arange(self.points)[:, None]
        blocks.append(
            (
                self.defects + point * self.per_point + rows[inside] - self.nq,
                point * self.nz + columns[inside],
            )
        )
        goal_rows, goal_columns = instants.goal_jacobian
        held, first = goal_rows < len(problem.goal), self.rows - len(problem.goal)
        blocks.append((first + goal_rows[held], (self.points - 1) * self.nz + goal_columns[held]))
        self._jacobian = SparseSums.of(blocks, (self.rows, self.size))
        rows, columns = instants.hessian
        every, last = np.arange(self.size - 1), (self.points - 1) * self.nz
        blocks = [
            (point * self.nz + rows, point * self.nz + columns),
            (last + instants.goal_hessian[0], last + instants.goal_hessian[1]),
            (every, np.full(every.shape, self.size - 1)),
        ]
        self._hessian = SparseSums.of(blocks, (self.size, self.size))
        self.jacobian_pattern, self.hessian_pattern = self._jacobian.matrix, self._hessian.matrix

    def split(self, w: Array) -> tuple[Array, float]:
        """Instants (points, nz) and duration [s] of the unknowns."""
        return w[:-1].reshape(self.points, self.nz), float(w[-1])

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns; they include a fixed start and a fixed duration."""
        problem = self.problem
        lower, upper = (np.tile(side, (self.points, 1)) for side in (problem.lower, problem.upper))
        lower[0, : self.nx], upper[0, : self.nx] = problem.start
        if problem.linear_drives:  # where limits of what the ends determine would be redundant
            inner = np.flatnonzero(np.arange(self.points) % self.inner)
            open_ = np.ix_(inner, np.array(problem.stage.drive_places, dtype=np.int64))
            lower[open_], upper[open_] = -np.inf, np.inf
        least, greatest, _ = problem.duration
        return np.append(lower, least), np.append(upper, greatest)

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the constraints."""
        sides = []
        share = self.lobatto.times(self.mesh, 1.0)
        for key in ("lower", "upper"):
            at = np.zeros((self.points, self.per_point))
            for k, row in enumerate(self.problem.path):
                free = np.inf if key == "upper" else -np.inf
                held = row.held(share, first_constrained(self.lobatto, self.mesh, row.final_fraction))
                at[:, self.nv + k] = np.where(held, getattr(row, key), free)
            goal = [getattr(row, key) for row in self.problem.goal]
            sides.append(np.concatenate([np.zeros(self.defects), at.ravel(), goal]))
        return sides[0], sides[1]

    def objective(self, w: Array) -> float:
        """Cost."""
        values, duration = self._at(w, "values"), float(w[-1])
        running = duration * (self._running(values) + self.problem.time_weight)
        if not self.end_weights.size:
            return running
        return running + float(self._last("goal_values", w)[len(self.problem.goal) :] @ self.end_weights)

    def gradient(self, w: Array) -> Array:
        """Gradient of the cost (size,)."""
        entries, duration = self._at(w, "jacobian"), float(w[-1])
        rows, columns = self.instants.jacobian
        cost_entries = rows >= self.ncost
        out = np.zeros((self.points, self.nz))
        weighted = self.term_weights[rows[cost_entries] - self.ncost] * entries[:, cost_entries]
        np.add.at(out.T, columns[cost_entries], (duration * self.weights[:, None] * weighted).T)
        if self.end_weights.size:
            rows, columns = self.instants.goal_jacobian
            end_entries, first = rows >= len(self.problem.goal), len(self.problem.goal)
            jacobian = self._last("goal_jacobian", w)[end_entries]
            np.add.at(out[-1], columns[end_entries], self.end_weights[rows[end_entries] - first] * jacobian)
        return np.append(out, self._running(self._at(w, "values")) + self.problem.time_weight)

    def constraints(self, w: Array) -> Array:
        """Values of all constraints (rows,)."""
        (z, duration), values = self.split(w), self._at(w, "values")
        x, rate = z[:, : self.nx], self._rates(z, values)
        moved = np.einsum("jk,nkx->njx", self.lobatto.integral[1:], rate[self._of])
        defects = x[self._of[:, 1:]] - x[self._of[:, :1]] - duration * self._parts * moved
        path_values = values[:, self.nq : self.ncost]
        goal = self._last("goal_values", w)[: len(self.problem.goal)]
        return np.concatenate([defects.ravel(), path_values.ravel(), goal])

    def jacobian(self, w: Array) -> Array:
        """Nonzero entries of the Jacobian of the constraints, in the order of :attr:`jacobian_pattern`."""
        (z, duration), entries = self.split(w), self._at(w, "jacobian")
        step = duration * self._parts[..., None]
        rows, _ = self.instants.jacobian
        a = self.lobatto.integral[1:]
        shape = (self.intervals, self.inner, self.nx)
        # A defect is x_nj - x_n0 - T h_n sum_k A_jk x'_nk. Its derivatives are 1 and -1 by x_nj and x_n0,
        # -T h_n A_jk dq'/dz by an instant z_nk, -T h_n A_jk by its acceleration, and
        # -h_n sum_k A_jk x'_nk by the duration T.
        moving = entries[:, rows < self.nq][self._of]  # (N, s, entries)
        by_rate = -step * np.einsum("jk,nke->njke", a, moving)
        by_acceleration = np.broadcast_to(-step * a[:, :, None], (*shape[:2], self.inner + 1, self.nv))
        rate = self._rates(z, self._at(w, "values"))
        by_time = -self._parts * np.einsum("jk,nkx->njx", a, rate[self._of])
        path_entries = entries[:, (rows >= self.nq) & (rows < self.ncost)]
        goal = self._last("goal_jacobian", w)[self.instants.goal_jacobian[0] < len(self.problem.goal)]
        parts = [np.ones(shape), -np.ones(shape), by_rate, by_acceleration, by_time, path_entries, goal]
        return self._jacobian.entries(np.concatenate([part.ravel() for part in parts]))

    def hessian(self, w: Array, factor: float, multipliers: Array) -> Array:
        """Nonzero entries of the Hessian of factor times cost plus multipliers times constraints.

        Only the upper triangle, in the order of :attr:`hessian_pattern`.
        """
        z, duration = self.split(w)
        # The defects add -T sum_n h_n sum_jk A_jk lambda_nj' x'_nk to the Lagrangian. So the rates at a point
        # have the weight T `pulled`, with -h_n sum_j A_jk lambda_nj summed over the intervals that share it.
        # `weights` holds the weights of F's rows at each point; those of rates and costs per unit of T, so
        # that they are also the second derivatives by T and z, times the first derivatives of F.
        first = self.rows - len(self.problem.goal)
        of_defects = multipliers[: self.defects].reshape(self.intervals, self.inner, self.nx)
        by_defects = -self._parts * np.einsum("jk,njx->nkx", self.lobatto.integral[1:], of_defects)
        pulled = np.zeros((self.points, self.nx))
        np.add.at(pulled, self._of, by_defects)
        path_multipliers = multipliers[self.defects : first].reshape(self.points, self.per_point)
        terms = factor * self.weights[:, None] * self.term_weights
        weights = np.hstack([pulled[:, : self.nq], path_multipliers, terms])
        scaled = weights.copy()
        scaled[:, : self.nq] *= duration
        scaled[:, self.ncost :] *= duration
        hessian = self.instants.call("hessian", self.problem.arguments(z), scaled.T).T
        goal = np.append(multipliers[first:], factor * self.end_weights)
        last = np.zeros(len(self.instants.goal_hessian[0]))
        if goal.size:  # a segment before the last one has neither goal nor costs of its end
            at_end = self.problem.arguments(z[-1:])
            last = self.instants.call("goal_hessian", at_end, goal[:, None])[:, 0]
        # second derivatives by the duration and each instant (points nz,)
        rows, columns = self.instants.jacobian
        entries = self._at(w, "jacobian")
        timed = (rows < self.nq) | (rows >= self.ncost)
        out = np.zeros((self.points, self.nz))
        contributions = weights[:, rows[timed]] * entries[:, timed]
        np.add.at(out.T, columns[timed], contributions.T)
        out[:, self.nx : self.nx + self.nv] += pulled[:, self.nq :]
        crossed = out.ravel()
        return self._hessian.entries(np.concatenate([hessian.ravel(), last, crossed]))

    def _running(self, values: Array) -> float:
        """Integral of the weighted cost terms over the duration, divided by the duration [1/s]."""
        return float(self.weights @ (values[:, self.ncost :] @ self.term_weights))

    def _rates(self, z: Array, values: Array) -> Array:
        """Rates x' at each point (points, nx)."""
        return np.hstack([values[:, : self.nq], z[:, self.nx : self.nx + self.nv]])

    def _last(self, name: str, w: Array) -> Array:
        """Evaluate a function at the last instant."""
        return self.instants.call(name, self.problem.arguments(self.split(w)[0][-1:]))[:, 0]

    def _at(self, w: Array, name: str) -> Array:
        """Evaluate a function at all points, with the values of the last unknowns cached."""
        key = w.tobytes()
        if self._seen[0] != key:
            self._seen = (key, {})
        cache = self._seen[1]
        if name not in cache:
            cache[name] = self.instants.call(name, self.problem.arguments(self.split(w)[0])).T
        return cache[name]

    def _by_point(self, defect: Array, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Rows and columns of the derivatives of defects by entries of their interval's instants."""
        row = defect[:, :, None, :][..., rows]  # (N, s - 1, 1, entries)
        column = self._of[:, None, :, None] * self.nz + columns
        shape = (self.intervals, self.inner, self.inner + 1, len(rows))
        return np.broadcast_to(row, shape), np.broadcast_to(column, shape)


def first_constrained(lobatto: Lobatto, mesh: Mesh, last: float) -> float:
    """First mesh point, as a fraction of the duration, of a constraint on its last fraction ``last``."""
    share = lobatto.times(mesh, 1.0)
    return float(share[share >= 1 - last - 1e-12][0])
