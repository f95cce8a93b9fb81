"""Exact first derivatives of a tuning problem at one point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from optim.problem.formulation import Formulation
from optim.problem.objectives import OBJECTIVE, error_rows
from optim.problem.problem import Linearisation
from spacerobot.arrays import Array
from spacerobot.rollout import Jacobian


def linearise_all(problem: Formulation, u: Array) -> list[Linearisation]:
    """Objective, constraints and their exact derivatives at points u (N, k) of the unit cube.

    By the adjoint, in lanes, where only the objective's gradient is needed, else by forward sensitivities;
    margins follow. Values are NaN where the rollout diverged.
    """
    found = _measured(problem, u)
    if problem.terms.margins is None:
        return found
    return [_with_margins(problem, *each) for each in zip(u, found, strict=True)]


def _measured(problem: Formulation, u: Array) -> list[Linearisation]:
    """All but margins."""
    if problem.form != "smooth" or problem.terms.limits:
        return [_linearise(problem, point) for point in u]
    found = problem.rollout.gradient_batch(
        problem.names, problem.variables.values(u), costs=[OBJECTIVE], threads=1, orders=False
    )
    slopes = np.array([problem.variables.slope(point) for point in u])
    gradients = found.gradients[OBJECTIVE] * slopes
    return [_plain(float(found.costs[OBJECTIVE][i]), gradients[i]) for i in range(len(u))]


def _with_margins(problem: Formulation, u: Array, at: Linearisation) -> Linearisation:
    """A linearisation at a point u (k,) with the margins' constraints and their part of the objective."""
    terms = problem.terms.margins
    assert terms is not None
    found = terms.values(problem.variables.values(u), slopes=True)
    values = np.array([one.value for one in found])
    slopes = np.array([one.gradient for one in found]) * problem.variables.slope(u)
    (g, by_margin), (penalty, weights) = terms.constraints(values), terms.penalty(values)
    limited = [i for i, row in enumerate(terms.rows) if row.requirement.least is not None]
    weighed = weights != 0
    added = weights[weighed] @ slopes[weighed]
    return replace(
        at,
        objective=at.objective + float(penalty),
        gradient=at.gradient + added,
        smooth=at.smooth + float(penalty),
        smooth_gradient=at.smooth_gradient + added,
        constraints=np.concatenate([at.constraints, g]),
        constraint_jacobian=np.concatenate([at.constraint_jacobian, by_margin[:, None] * slopes[limited]]),
    )


def _linearise(problem: Formulation, u: Array) -> Linearisation:
    """All but margins at one point u (k,), by forward sensitivities."""
    values = dict(zip(problem.names, problem.variables.values(u), strict=True))
    sampled = sampled_outputs(problem)
    jacobian = problem.rollout.jacobian(values, wrt=problem.names, outputs=sampled, orders=False)
    if jacobian.trajectory.status != "completed":
        sizes = problem.terms.measures.sizes
        return _nothing(sum(sizes[name] for name in problem.terms.limits), len(u))
    slope = problem.variables.slope(u)
    measures, k = jacobian.trajectory.measures, len(slope)
    value = float(jacobian.trajectory.costs[OBJECTIVE])
    gradient = _gradient(problem, jacobian) * slope
    limits = problem.terms.limits
    g = np.concatenate([np.empty(0), *(measures[n] / limit - 1 for n, limit in limits.items())])
    dg = np.concatenate([np.empty((0, k)), *(jacobian.measures[n] / limit for n, limit in limits.items())])
    rows = rows_of(problem, jacobian.trajectory.outputs)
    moved = {name: np.moveaxis(values, -1, 0) for name, values in jacobian.outputs.items()}
    rows_jacobian = rows_of(problem, moved).T * slope if len(rows) else np.empty((0, k))
    smooth, smooth_gradient = value, gradient
    if problem.form == "minimax":
        worst = int(rows.argmax())
        smooth, smooth_gradient = value - float(rows[worst]), gradient - rows_jacobian[worst]
    return Linearisation(value, gradient, g, dg * slope, rows, rows_jacobian, smooth, smooth_gradient)


def _gradient(problem: Formulation, jacobian: Jacobian) -> Array:
    """Derivative of the objective with respect to the variables' values (k,), by the chain rule."""
    names = problem.rollout.kernel.measures
    measures = np.concatenate([jacobian.trajectory.measures[name] for name in names])
    slopes = np.concatenate([jacobian.measures[name] for name in names])
    towards = problem.objective_slope(measures, problem.rollout.values(None)).full().ravel()
    return np.asarray(towards @ slopes, dtype=np.float64)


def sampled_outputs(problem: Formulation) -> tuple[str, ...]:
    """Outputs whose samples the objective is made of."""
    outputs = [*problem.terms.residuals] + (["tip_error"] if problem.form == "minimax" else [])
    return tuple(dict.fromkeys(outputs))


def rows_of(problem: Formulation, outputs: Mapping[str, Array]) -> Array:
    """Rows (..., n) of sampled outputs (..., nt, c), or of their derivatives; see :class:`Linearisation`.

    A minimax problem has each error twice, with either sign, one after the other over time.
    """
    if problem.form == "smooth":
        return np.empty(0)
    if problem.form == "minimax":
        tuning = problem.scene.scenario.tuning
        weight = 1.0 if tuning is None else tuning.objective.weight
        error = weight * np.swapaxes(outputs["tip_error"][..., error_rows(problem.scene)], -1, -2)
        flat = error.reshape(*error.shape[:-2], -1)
        return np.concatenate([flat, -flat], axis=-1)
    step = problem.rollout.grid.duration_s / problem.rollout.grid.intervals
    rows = []
    for name, (weight, factor) in problem.terms.residuals.items():
        scaled = outputs[name] * (np.sqrt(weight * step) * factor)
        rows.append(scaled.reshape(*scaled.shape[:-2], -1))
    return np.concatenate(rows, axis=-1)


def _plain(value: float, gradient: Array) -> Linearisation:
    none, k = np.empty(0), len(gradient)
    return Linearisation(
        value, gradient, none, np.empty((0, k)), none, np.empty((0, k)), value, np.array(gradient)
    )


def _nothing(m: int, k: int) -> Linearisation:
    """Linearisation where the rollout diverged: all NaN."""
    plain = _plain(np.nan, np.full(k, np.nan))
    return replace(plain, constraints=np.full(m, np.nan), constraint_jacobian=np.full((m, k), np.nan))
