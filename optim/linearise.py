"""Exact first derivatives of a tuning problem at one point."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from optim.objectives import OBJECTIVE, error_rows
from optim.protocol import Array, Linearisation
from spacerobot.rollout import Jacobian

if TYPE_CHECKING:
    from optim.problem import TuningProblem

WINDOWS = 250  # rows of a minimax problem: for each error the largest and the least value in so many windows


def linearise(problem: TuningProblem, u: Array) -> Linearisation:
    """Objective, constraints and their exact derivatives at one point u (k,) of the unit cube.

    By the adjoint where only the objective's gradient is needed, else by forward sensitivities. Values are
    NaN where the rollout diverged.
    """
    values = dict(zip(problem.names, problem.variables.values(u), strict=True))
    slope = problem.variables.slope(u)
    if problem.form == "smooth" and not problem.terms.limits:
        found = problem.rollout.value_and_gradient(values, wrt=problem.names, costs=[OBJECTIVE])
        return _plain(float(found.costs[OBJECTIVE]), found.gradients[OBJECTIVE] * slope)
    outputs = [*problem.terms.residuals] + (["tip_error"] if problem.form == "minimax" else [])
    jacobian = problem.rollout.jacobian(values, wrt=problem.names, outputs=tuple(dict.fromkeys(outputs)))
    if jacobian.trajectory.status != "completed":
        return _nothing(len(problem.constraint_names), len(u))
    return _assembled(problem, jacobian, slope)


def _assembled(problem: TuningProblem, jacobian: Jacobian, slope: Array) -> Linearisation:
    measures, k = jacobian.trajectory.measures, len(slope)
    value = float(jacobian.trajectory.costs[OBJECTIVE])
    gradient = _gradient(problem, jacobian) * slope
    limits = problem.terms.limits
    g = np.concatenate([np.empty(0), *(measures[n] / limit - 1 for n, limit in limits.items())])
    dg = np.concatenate([np.empty((0, k)), *(jacobian.measures[n] / limit for n, limit in limits.items())])
    rows, rows_jacobian = _rows(problem, jacobian)
    smooth, smooth_gradient = value, gradient
    if problem.form == "minimax":
        smooth, smooth_gradient = _beside_peak(problem, jacobian, value, gradient, slope)
    return Linearisation(value, gradient, g, dg * slope, rows, rows_jacobian * slope, smooth, smooth_gradient)


def _gradient(problem: TuningProblem, jacobian: Jacobian) -> Array:
    """Derivative of the objective with respect to the variables' values (k,), by the chain rule."""
    names = problem.rollout.kernel.measures
    measures = np.concatenate([jacobian.trajectory.measures[name] for name in names])
    slopes = np.concatenate([jacobian.measures[name] for name in names])
    towards = problem.objective_slope(measures, problem.rollout.values(None)).full().ravel()
    return np.asarray(towards @ slopes, dtype=np.float64)


def _peak_weight(problem: TuningProblem) -> float:
    """Factor of the largest error in a minimax objective."""
    tuning = problem.scene.scenario.tuning
    return 1.0 if tuning is None else tuning.objective.weight


def _beside_peak(
    problem: TuningProblem, jacobian: Jacobian, value: float, gradient: Array, slope: Array
) -> tuple[float, Array]:
    """What a minimax objective holds beside the largest error."""
    weight, peaks = _peak_weight(problem), jacobian.trajectory.measures["tip_error_peak"]
    worst = int(np.argmax(peaks))
    own = weight * jacobian.measures["tip_error_peak"][worst] * slope
    return value - weight * float(peaks[worst]), gradient - own


def _rows(problem: TuningProblem, jacobian: Jacobian) -> tuple[Array, Array]:
    k = len(problem.names)
    if problem.form == "smooth":
        return np.empty(0), np.empty((0, k))
    if problem.form == "minimax":
        return _window_peaks(problem, jacobian)
    step = problem.rollout.grid.duration_s / problem.rollout.grid.intervals
    rows, slopes = [], []
    for name, (weight, factor) in problem.terms.residuals.items():
        scale = np.sqrt(weight * step) * factor
        rows.append((jacobian.trajectory.outputs[name] * scale).ravel())
        slopes.append((jacobian.outputs[name] * scale[:, None]).reshape(-1, k))
    return np.concatenate(rows), np.concatenate(slopes)


def _window_peaks(problem: TuningProblem, jacobian: Jacobian) -> tuple[Array, Array]:
    """Largest and least value of each error in each window of time, and its derivative there."""
    columns, weight = error_rows(problem.scene), _peak_weight(problem)
    error = weight * jacobian.trajectory.outputs["tip_error"][:, columns]
    slope = weight * jacobian.outputs["tip_error"][:, columns]
    rows, slopes = [], []
    for part in np.array_split(np.arange(len(error)), min(WINDOWS, len(error))):
        for sign in (1, -1):
            when = part[(sign * error[part]).argmax(axis=0)]
            each = np.arange(error.shape[1])
            rows.append(sign * error[when, each])
            slopes.append(sign * slope[when, each])
    return np.concatenate(rows), np.concatenate(slopes)


def _plain(value: float, gradient: Array) -> Linearisation:
    none, k = np.empty(0), len(gradient)
    return Linearisation(
        value, gradient, none, np.empty((0, k)), none, np.empty((0, k)), value, np.array(gradient)
    )


def _nothing(m: int, k: int) -> Linearisation:
    """What is known of a rollout that diverged."""
    plain = _plain(np.nan, np.full(k, np.nan))
    return replace(plain, constraints=np.full(m, np.nan), constraint_jacobian=np.full((m, k), np.nan))
