"""Operations of workers on a tuning problem: rows in, arrays out, each row independently, on one thread."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optim.problem.formulation import Formulation
from optim.problem.linearise import linearise_all, rows_of, sampled_outputs
from optim.problem.objectives import MARGINS, OBJECTIVE
from optim.workers import Arrays
from spacerobot.arrays import Array


def measures(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Objective (N,) and measures (N, n) of rows (N, k) of parameters."""
    batch = problem.rollout.batch(paths, rows, threads=1)
    return _with_margins(problem, rows, paths, {OBJECTIVE: batch.costs[OBJECTIVE], **batch.measures})


def samples(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """The same, and the rows (N, n) that the objective is made of."""
    batch = problem.rollout.batch(paths, rows, outputs=sampled_outputs(problem), threads=1)
    found = {OBJECTIVE: batch.costs[OBJECTIVE], "rows": rows_of(problem, batch.outputs), **batch.measures}
    return _with_margins(problem, rows, paths, found)


def _with_margins(problem: Formulation, rows: Array, paths: Sequence[str], found: dict[str, Array]) -> Arrays:
    """Results of rollouts, and the margins' constraints and part of the objective; none on other plants."""
    terms = problem.terms.margins
    if terms is None or tuple(paths) != problem.names:
        return found
    values = np.array([[one.value for one in terms.values(row)] for row in rows])
    found[OBJECTIVE] = found[OBJECTIVE] + terms.penalty(values)[0]
    return found | {MARGINS: terms.constraints(values)[0]}


def gradients(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Objective (N,) and its gradient (N, k) with respect to the variables' values, by the adjoint."""
    found = problem.rollout.gradient_batch(
        paths, rows, wrt=problem.names, costs=[OBJECTIVE], threads=1, orders=False
    )
    return {OBJECTIVE: found.costs[OBJECTIVE], "gradient": found.gradients[OBJECTIVE]}


def limited(problem: Formulation, rows: Array, *, paths: Sequence[str]) -> Arrays:
    """Constraints (N, m) and their derivatives (N, m, k) with respect to the variables' values."""
    found = problem.rollout.slope_batch(paths, rows, wrt=problem.names, threads=1, orders=False)
    limits = problem.terms.limits
    return {
        "constraints": np.concatenate([found.measures[n] / limit - 1 for n, limit in limits.items()], axis=1),
        "jacobian": np.concatenate([found.slopes[n] / limit for n, limit in limits.items()], axis=1),
    }


def linearisations(problem: Formulation, rows: Array) -> Arrays:
    """Fields of the linearisation at points (N, k) of the unit cube."""
    found = [at.as_arrays() for at in linearise_all(problem, rows)]
    return {name: np.stack([fields[name] for fields in found]) for name in found[0]}
