"""Local models of a descent: values and first derivatives at a point, and the step that minimises the model.

The values at a point form one vector y = (s, g, r): the smooth part of the objective, the constraints, and
the rows. Each is smooth in u, although the objective s + outer(r), with outer a maximum or a sum of squares,
need not be. The model of a step d is convex,

    phi(d) = [s + b d + d'Bd/2 + outer(r + R d)] / scale + weight * max(0, g + G d),

and is minimised over a box: by a linear program if outer is the maximum and B vanishes, otherwise by a
quadratic one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from optim.problem.problem import Evaluation, Form, Linearisation
from spacerobot.common.arrays import Array

Places = npt.NDArray[np.int_]
FIRST_ROWS = 40  # of a minimax problem's rows that the first program holds
MORE_ROWS = 20  # that each further one adds, of those that its step would pass
PASSED = 1e-9  # by how much of the largest row
NEAR = 0.5  # of the largest row: what is nearer decides how far a variable may move
MARGIN = 1e-5  # that constraints are kept away from their limits
QP_ITERATIONS = 1000  # many times what a program of these sizes takes
FLAT = 0.01  # least weight of a variable that hardly matters, of that which matters most


@dataclass(frozen=True)
class EvaluatedPoint:
    """Values at a point u (k,): objective, constraints (m,) and rows (n,)."""

    u: Array
    objective: float
    constraints: Array
    rows: Array

    @classmethod
    def all_of(cls, u: Array, evaluation: Evaluation) -> list[EvaluatedPoint]:
        """Points u (N, k) with the values found there."""
        rows = np.empty((len(u), 0)) if evaluation.rows is None else evaluation.rows
        return [
            cls(u[i], float(evaluation.objective[i]), evaluation.constraints[i], rows[i])
            for i in range(len(u))
        ]

    @classmethod
    def of(cls, u: Array, at: Linearisation) -> EvaluatedPoint:
        """A point that was linearised."""
        return cls(u, at.objective, at.constraints, at.rows)

    @property
    def known(self) -> bool:
        """Whether the rollout came to its end."""
        return bool(np.isfinite(self.objective) and np.isfinite(self.constraints).all())

    @property
    def excess(self) -> float:
        """Largest violation of a constraint, the margin kept."""
        return float((self.constraints + MARGIN).max(initial=0.0))

    def stacked(self, form: Form) -> Array:
        """Y (1 + m + n,)."""
        return np.concatenate([[self.objective - outer(form, self.rows)], self.constraints, self.rows])


def outer(form: Form, rows: Array) -> float:
    """Contribution of the rows to the objective."""
    if form == "minimax":
        return float(rows.max())
    return float(rows @ rows)


@dataclass(frozen=True)
class LocalModel:
    """Local model phi(d) of the objective and the constraints about a point, as in the module's formula.

    The derivatives are exact or come from secants.

    Attributes:
        form: Form of the objective.
        at: Evaluated point.
        slopes: Jacobian dy/du (1 + m + n, k), the rows b, G and R.
        curvature: B (k, k), approximate Hessian of the smooth part s.
        scale: Magnitude by which the merit function divides the objective.
        weight: Weight of the largest violation in the merit function.
    """

    form: Form
    at: EvaluatedPoint
    slopes: Array
    curvature: Array
    scale: float
    weight: float

    def merit(self, point: EvaluatedPoint) -> float:
        """Phi at another point; infinite where the rollout diverged."""
        if not point.known:
            return np.inf
        return point.objective / self.scale + self.weight * point.excess

    @property
    def reach(self) -> Array:
        """Weight (k,) of each variable in the length of a step: its effect on the largest rows, 1 at most."""
        rows, slopes = self.at.rows, self.slopes[1 + len(self.at.constraints) :]
        if not len(rows):
            return np.ones(self.slopes.shape[1])
        size = np.abs(rows)
        change = np.abs(slopes[size >= NEAR * size.max()]).max(axis=0)
        return np.asarray(np.maximum(change / max(change.max(), np.finfo(float).tiny), FLAT))

    def step(self, radius: float) -> tuple[Array, float]:
        """Best step (k,) of the model whose weighted length is at most a radius, and the fall it predicts."""
        u, size = self.at.u, radius / self.reach
        lower, upper = np.maximum(-size, -u), np.minimum(size, 1 - u)
        box, m, linear = (lower, upper), len(self.at.constraints), self.slopes[0]
        rows, slopes = self.at.rows, self.slopes[1 + m :]
        if self.form != "minimax":
            curvature = self.curvature + 2 * slopes.T @ slopes
            empty = np.empty((0, len(linear)))
            d = self._program(linear + 2 * rows @ slopes, curvature, np.empty(0), empty, box)
        else:  # over the rows that matter, found by adding those that the last step would pass
            far = np.abs(slopes) @ np.maximum(-lower, upper)
            chosen = _crests(rows + far, FIRST_ROWS)
            while True:
                d = self._program(linear, self.curvature, rows[chosen], slopes[chosen], box)
                after = rows + slopes @ d
                top = after[chosen].max()
                passed = np.where(after > top + PASSED * np.abs(rows).max(), after, -np.inf)
                passed[chosen] = -np.inf
                if not np.isfinite(passed).any():
                    break
                chosen = np.union1d(chosen, _crests(passed, MORE_ROWS))
        d = np.clip(d, lower, upper)
        return d, self._predicted(np.zeros_like(d)) - self._predicted(d)

    def _predicted(self, d: Array) -> float:
        m = len(self.at.constraints)
        y = self.at.stacked(self.form) + self.slopes @ d
        value = y[0] + d @ self.curvature @ d / 2 + outer(self.form, y[1 + m :])
        return float(value / self.scale + self.weight * (y[1 : 1 + m] + MARGIN).max(initial=0.0))

    def _program(
        self, linear: Array, curvature: Array, rows: Array, slopes: Array, box: tuple[Array, Array]
    ) -> Array:
        """Step d (k,) that minimises linear d + d'Bd/2 + t + v.

        The slacks are t >= r + R d, the maximum of the rows, and v >= 0 with v >= g + G d, the violation.
        The terms are divided by the scale, and v is multiplied by the weight.
        """
        m, k, n = len(self.at.constraints), len(linear), len(rows)
        cost = np.concatenate([linear / self.scale, [float(n > 0)], [float(m > 0)]])
        hessian = np.zeros((k + 2, k + 2))
        hessian[:k, :k] = curvature / self.scale
        peaks = np.hstack([slopes / self.scale, -np.ones((n, 1)), np.zeros((n, 1))])
        limits = np.hstack([self.slopes[1 : 1 + m], np.zeros((m, 1)), -np.ones((m, 1)) / self.weight])
        bounds = np.concatenate([-rows / self.scale, -self.at.constraints - MARGIN])
        low, high = box
        lower, upper = np.append(low, [-np.inf, 0.0]), np.append(high, [np.inf, np.inf])
        if not n:
            lower[k] = upper[k] = 0.0
        return solve_program(cost, hessian, np.vstack([peaks, limits]), bounds, (lower, upper))[:k]


def solve_program(
    cost: Array, hessian: Array, matrix: Array, bounds: Array, box: tuple[Array, Array]
) -> Array:
    """Minimiser x of cost' x + x'Hx/2 subject to matrix x <= bounds and a box, by HiGHS; zero if it fails."""
    flat = not hessian.any()
    sizes = {"a": ca.Sparsity.dense(*matrix.shape)}
    values: dict[str, Any] = {"g": cost, "a": matrix, "lba": -np.inf, "uba": bounds}
    if not flat:
        sizes["h"], values["h"] = ca.Sparsity.dense(*hessian.shape), hessian
    # its method for quadratic programs may go round in circles where the hessian is nearly singular
    settings = {"output_flag": False, "threads": 1, "qp_iteration_limit": QP_ITERATIONS}
    options: dict[str, Any] = {"error_on_fail": False, "highs": settings}
    solver = ca.conic("step", "highs", sizes, options)
    solution = solver(**values, lbx=box[0], ubx=box[1])
    x = solution["x"].full().ravel()
    return x if np.isfinite(x).all() else np.zeros(len(cost))


def _crests(values: Array, count: int) -> Places:
    """Indices of the largest values, of neighbours in time only the largest."""
    before, after = np.append(-np.inf, values[:-1]), np.append(values[1:], -np.inf)
    crests = np.flatnonzero((values >= before) & (values > after) & np.isfinite(values))
    if not len(crests):
        crests = np.array([int(values.argmax())])
    return crests[np.argsort(-values[crests], kind="stable")[:count]]
