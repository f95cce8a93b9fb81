"""Local search by a trust-region method, as a generator of evaluation requests.

The generator yields requests for values or derivatives at points and is sent the answers, so that many
searches advance in lockstep and share vectorised rollouts. For objectives made of rows (a maximum, a sum of
squares), the derivatives of all rows are first computed by differences in one batch; Broyden's update
corrects them after each rollout. They are recomputed when steps no longer reduce the merit. A smooth
objective has its gradient evaluated at every accepted point, and BFGS approximates the curvature. Exact
derivatives replace differences if they cost less (:attr:`DescentSettings.exact`), or if rollouts at the
points of the differences diverge.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from optim.methods.local_model import MARGIN, EvaluatedPoint, LocalModel
from optim.problem.problem import Form, Linearisation
from spacerobot.common.arrays import Array

ACCEPTED, POOR, GOOD = 0.05, 0.25, 0.75  # of the predicted fall
LARGEST, SMALLEST = 1.0, 1e-5  # radius
PATIENCE = 15  # steps that together must lower the objective by more than the tolerance
DIFFERENCE = 3e-5  # of the unit cube
WEIGHT = 10.0  # of the largest violation at first
HEAVIEST = 1e5  # weight beyond which the point counts as infeasible
STALE = 2  # steps in a row that fail before derivatives from secants are taken anew


@dataclass(frozen=True)
class EvaluationRequest:
    """Request of a descent for samples, or linearisations, at points (N, k).

    The answer is a list of :class:`optim.methods.local_model.EvaluatedPoint`, or of linearisations.
    """

    kind: Literal["sample", "linearise"]
    points: Array


@dataclass(frozen=True)
class DescentResult:
    """Final point of a descent, its status and its number of steps."""

    status: str
    message: str
    point: EvaluatedPoint
    steps: int


FLAT = (
    "all derivatives of the objective are zero here, as where pulses are rounded to a `resolution` (set it "
    "to 0) or an event does not happen; evolutionary methods need none"
)
"""Final message of a descent if all derivatives of the objective are zero; its status is ``settled``."""


@dataclass(frozen=True)
class DescentSettings:
    """Settings of a descent.

    Attributes:
        form: Form of the objective.
        exact: Whether exact derivatives cost less than differences; every point is then linearised.
        radius: Radius of the first step, in the unit cube.
        steps: Maximum number of steps.
        tolerance: Predicted decrease of the objective, relative to its value, at which the descent ends.
    """

    form: Form
    exact: bool
    radius: float
    steps: int
    tolerance: float


Asking = Generator[EvaluationRequest, Any, Any]


def descend(
    start: EvaluatedPoint, manner: DescentSettings
) -> Generator[EvaluationRequest, Any, DescentResult]:
    """Descend from a point with known values.

    Args:
        start: The point.
        manner: Settings of the descent.
    """
    if not start.known:
        return DescentResult("failed", "the rollout diverges at the start", start, 0)
    state, falls = _State(start, manner), list[float]()
    for step in range(manner.steps):
        if state.model is None and not (yield from state.renew()):
            return DescentResult("failed", "the rollout diverges all around the point", state.at, step)
        ended = yield from state.advance()
        if ended:
            status, message = ended
            return DescentResult(status, message, state.at, step + 1)
        falls.append(state.at.objective if state.at.excess <= 2 * MARGIN else np.inf)
        if len(falls) > PATIENCE and falls[-1 - PATIENCE] - falls[-1] < manner.tolerance * abs(falls[-1]):
            return DescentResult("settled", "no further improvement", state.at, step + 1)
    return DescentResult("steps spent", "the best point so far is kept", state.at, manner.steps)


class _State:
    """Current point of a descent."""

    def __init__(self, start: EvaluatedPoint, manner: DescentSettings) -> None:
        self.at = start
        self.model: LocalModel | None = None
        self._manner, self._radius, self._failed, self._fresh = manner, manner.radius, 0, False
        k = len(start.u)
        self._curvature, self._curved = np.zeros((k, k)), False
        self._weight, self._largest = WEIGHT, abs(start.objective)
        self._known: tuple[Array, Array] | None = None  # where differences were last taken, and the gradient

    @property
    def _scale(self) -> float:
        """Scale of decreases: the objective; the largest one so far while a constraint is violated."""
        share = 1e-9 if self.at.excess <= 2 * MARGIN else 1.0
        return max(abs(self.at.objective), share * self._largest, np.finfo(float).tiny)

    def renew(self) -> Asking:
        """Recompute the derivatives at the point; returns whether they are finite."""
        if self._manner.exact:
            (linearisation,) = yield EvaluationRequest("linearise", self.at.u[None])
            slopes = _exact(linearisation, self._manner.form)
        else:
            # by one rollout more for each variable; by exact ones where those diverge
            u, form = self.at.u, self._manner.form
            moved = np.where(u + DIFFERENCE <= 1, DIFFERENCE, -DIFFERENCE)
            points = yield EvaluationRequest("sample", u + np.diag(moved))
            if all(point.known for point in points):
                y, near = self.at.stacked(form), zip(points, moved, strict=True)
                slopes = np.stack([(p.stacked(form) - y) / h for p, h in near], axis=1)
            else:
                (linearisation,) = yield EvaluationRequest("linearise", u[None])
                slopes = _exact(linearisation, form)
            if self._manner.form == "smooth" and self._known is not None:
                self._bend(self.at.u - self._known[0], slopes[0] - self._known[1])
            self._known = (self.at.u, slopes[0])
        if not np.isfinite(slopes).all():
            return False
        self._renewed(slopes)
        return True

    def _renewed(self, slopes: Array) -> None:
        self.model = LocalModel(
            self._manner.form, self.at, slopes, self._curvature, self._scale, self._weight
        )
        self._fresh, self._failed = True, 0

    def advance(self) -> Asking:
        """Try one step; returns the final status and message if the descent ends, else None."""
        assert self.model is not None
        model, tolerance = self.model, self._manner.tolerance
        d, fall = model.step(self._radius)
        if fall < tolerance:
            # recompute the derivatives, enlarge the region, weigh violations more, or end
            if not self._fresh:
                self.model = None
                return None
            near = self._failed == 0 and self._radius < LARGEST / 2
            if near and model.step(LARGEST)[1] >= 3 * tolerance:
                self._radius = min(LARGEST, 4 * self._radius)
                return None
            if self.at.excess > 2 * MARGIN and self._weight < HEAVIEST:
                self._weight *= 10
                self.model = replace(model, weight=self._weight)
                return None
            if self.at.excess > 2 * MARGIN:
                return "infeasible", f"a constraint is passed by {100 * self.at.excess:.3g} % at least nearby"
            if not np.delete(model.slopes, np.arange(len(self.at.constraints)) + 1, axis=0).any():
                return "settled", FLAT
            return "converged", "no step promises a further fall"
        u, slopes = np.clip(self.at.u + d, 0.0, 1.0), None
        if self._manner.exact:
            (linearisation,) = yield EvaluationRequest("linearise", u[None])
            trial, slopes = EvaluatedPoint.of(u, linearisation), _exact(linearisation, self._manner.form)
        else:
            (trial,) = yield EvaluationRequest("sample", u[None])
        ratio = (model.merit(self.at) - model.merit(trial)) / fall
        length = float((np.abs(d) * model.reach).max())
        if ratio < POOR:
            self._radius = (0.5 if ratio < 0 else 0.7) * length
        elif ratio > GOOD and length > 0.99 * self._radius:
            self._radius = min(LARGEST, 2 * self._radius)
        if trial.known:  # correct the model by what the trial showed
            self._largest = max(self._largest, abs(trial.objective))
            if slopes is not None:
                self._bend(d, slopes[0] - model.slopes[0])
                self.model = replace(model, curvature=self._curvature)
            else:
                y = trial.stacked(model.form) - model.at.stacked(model.form)
                weighted = d * model.reach**2
                secant = np.outer(y - model.slopes @ d, weighted) / (d @ weighted)
                self.model, self._fresh = replace(model, slopes=model.slopes + secant), False
        if ratio > ACCEPTED:
            self.at, self._failed = trial, 0
            if slopes is not None:
                self._renewed(slopes)
            elif self._manner.form == "smooth" or self.model is None:
                self.model = None
            else:
                self.model = replace(self.model, at=trial, scale=self._scale)
                self._fresh = False
        else:
            self._failed += 1
            if not self._fresh and self._failed >= STALE:
                self.model = None
        if self._radius < SMALLEST:
            return "settled", "steps became too small to change anything"
        return None

    def _bend(self, d: Array, y: Array) -> None:
        """Update B by BFGS, with Powell's damping so that it stays positive definite."""
        if not self._curved:
            if d @ y <= 0:
                return
            self._curvature, self._curved = np.eye(len(d)) * (y @ y) / (d @ y), True
        bent = self._curvature @ d
        there = float(d @ bent)
        if there <= 0:
            return
        if d @ y < 0.2 * there:
            share = 0.8 * there / (there - d @ y)
            y = share * y + (1 - share) * bent
        self._curvature = self._curvature - np.outer(bent, bent) / there + np.outer(y, y) / (d @ y)


def _exact(at: Linearisation, form: Form) -> Array:
    """Derivative of y (1 + m + n, k) from a linearisation."""
    beside = at.smooth_gradient if form == "minimax" else at.gradient
    if form == "squares":
        beside = beside - 2 * at.rows @ at.rows_jacobian
    return np.vstack([beside, at.constraint_jacobian, at.rows_jacobian])
