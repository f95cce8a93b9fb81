"""Operations of workers on a tuning problem: rows in, arrays out, each row independently, on one thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optim.problem.formulation import Formulation
from optim.problem.objectives import MARGINS, OBJECTIVE, error_rows
from optim.problem.problem import Linearisation
from optim.workers import Arrays
from spacerobot.common.arrays import Array


def measures(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Objective (N,) and measures (N, n) of rows (N, k) of parameters."""
    batch = problem.rollout.batch(paths, rows, threads=1)
    return _with_margins(problem, rows, paths, {OBJECTIVE: batch.costs[OBJECTIVE], **batch.measures})


def samples(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Measures, and the rows (N, n) of the objective."""
    batch = problem.rollout.batch(paths, rows, outputs=sampled_outputs(problem), threads=1)
    arrays = {OBJECTIVE: batch.costs[OBJECTIVE], "rows": rows_of(problem, batch.outputs), **batch.measures}
    return _with_margins(problem, rows, paths, arrays)


def _with_margins(
    problem: Formulation, rows: Array, paths: Sequence[str], arrays: dict[str, Array]
) -> Arrays:
    """Results of rollouts, and the margins' constraints and part of the objective; none on other plants."""
    terms = problem.terms.margins
    if terms is None or tuple(paths) != problem.names:
        return arrays
    values = np.array([[one.value for one in terms.values(row)] for row in rows])
    arrays[OBJECTIVE] = arrays[OBJECTIVE] + terms.penalty(values)[0]
    return arrays | {MARGINS: terms.constraints(values)[0]}


def gradients(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Objective (N,) and its gradient (N, k) with respect to the variables' values, by the adjoint."""
    batch = problem.rollout.gradient_batch(
        paths, rows, wrt=problem.names, costs=[OBJECTIVE], threads=1, orders=False
    )
    return {OBJECTIVE: batch.costs[OBJECTIVE], "gradient": batch.gradients[OBJECTIVE]}


def limited(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Constraints (N, m) and their derivatives (N, m, k) with respect to the variables' values."""
    slopes = problem.rollout.slope_batch(paths, rows, wrt=problem.names, threads=1, orders=False)
    limits = problem.terms.limits
    return {
        "constraints": np.concatenate(
            [slopes.measures[n] / limit - 1 for n, limit in limits.items()], axis=1
        ),
        "jacobian": np.concatenate([slopes.slopes[n] / limit for n, limit in limits.items()], axis=1),
    }


def linearisations(problem: Formulation, rows: Array) -> Arrays:
    """Fields of the linearisation at points (N, k) of the unit cube."""
    fields_by_point = [at.as_arrays() for at in linearise_all(problem, rows)]
    return {name: np.stack([fields[name] for fields in fields_by_point]) for name in fields_by_point[0]}


def linearise_all(problem: Formulation, u: Array) -> list[Linearisation]:
    """Objective, constraints and their exact derivatives at points u (N, k) of the unit cube.

    By the adjoint, in lanes, where only the objective's gradient is needed, else by forward sensitivities;
    margins follow. Values are NaN where the rollout diverged.
    """
    if problem.form != "smooth" or problem.terms.limits:
        linearisations_at = [_linearise(problem, point) for point in u]
    else:
        values = problem.variables.values(u)
        plain = problem.rollout.gradient_batch(
            problem.names, values, costs=[OBJECTIVE], threads=1, orders=False
        )
        gradients = plain.gradients[OBJECTIVE] * np.array([problem.variables.slope(point) for point in u])
        costs = map(float, plain.costs[OBJECTIVE])
        linearisations_at = [Linearisation.of_smooth(*each) for each in zip(costs, gradients, strict=True)]
    terms = problem.terms.margins
    if terms is None:
        return linearisations_at
    limited = [i for i, row in enumerate(terms.rows) if row.requirement.least is not None]
    for k, (point, at) in enumerate(zip(u, linearisations_at, strict=True)):
        margins = terms.values(problem.variables.values(point), slopes=True)
        values = np.array([one.value for one in margins])
        slopes = np.array([one.gradient for one in margins]) * problem.variables.slope(point)
        (g, by_margin), (penalty, weights) = terms.constraints(values), terms.penalty(values)
        weighed = weights != 0
        added = weights[weighed] @ slopes[weighed]
        jacobian = np.concatenate([at.constraint_jacobian, by_margin[:, None] * slopes[limited]])
        linearisations_at[k] = replace(
            at,
            objective=at.objective + float(penalty),
            gradient=at.gradient + added,
            smooth=at.smooth + float(penalty),
            smooth_gradient=at.smooth_gradient + added,
            constraints=np.concatenate([at.constraints, g]),
            constraint_jacobian=jacobian,
        )
    return linearisations_at


def _linearise(problem: Formulation, u: Array) -> Linearisation:
    """Linearise all but the margins at one point u (k,), by forward sensitivities."""
    values = dict(zip(problem.names, problem.variables.values(u), strict=True))
    sampled = sampled_outputs(problem)
    jacobian = problem.rollout.jacobian(values, wrt=problem.names, outputs=sampled, orders=False)
    if jacobian.trajectory.status != "completed":
        sizes = problem.terms.measures.sizes
        m, k = sum(sizes[name] for name in problem.terms.limits), len(u)
        nothing = Linearisation.of_smooth(np.nan, np.full(k, np.nan))
        return replace(nothing, constraints=np.full(m, np.nan), constraint_jacobian=np.full((m, k), np.nan))
    slope = problem.variables.slope(u)
    measures, k = jacobian.trajectory.measures, len(slope)
    value = float(jacobian.trajectory.costs[OBJECTIVE])
    # derivative of the objective with respect to the variables' values (k,), by the chain rule
    names = problem.rollout.kernel.measures
    by_variables = np.concatenate([jacobian.measures[name] for name in names])
    towards = problem.objective_slope(
        np.concatenate([measures[name] for name in names]), problem.rollout.values(None)
    )
    gradient = np.asarray(towards.full().ravel() @ by_variables, dtype=np.float64) * slope
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


def sampled_outputs(problem: Formulation) -> tuple[str, ...]:
    """Names of the outputs whose samples are the components of the objective."""
    outputs = [output for output, _, _ in problem.terms.residuals]
    return tuple(dict.fromkeys([*outputs, *["tip_error"] * (problem.form == "minimax")]))


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
    for name, weight, entries in problem.terms.residuals:
        scaled = np.sqrt(weight * step) * outputs[name][..., entries]
        rows.append(scaled.reshape(*scaled.shape[:-2], -1))
    return np.concatenate(rows, axis=-1)
