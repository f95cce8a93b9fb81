"""Multipliers of the constraints along a plan."""

from __future__ import annotations

import numpy as np

from optim.planning.search.make_plan import PlanSolution
from spacerobot.arrays import Array


def multiplier_norms(planned: PlanSolution) -> Array:
    """Norms of the multipliers at all points of a plan's phases, one after the other (points,).

    Those of the equations of motion and of all limits at a point, as densities over time, so that they do not
    depend on the mesh: what the cost, in its own units, would save for a unit of each and a second. Those of
    the collocation and of the goals are left out.

    Parameters
    ----------
    planned
        The plan.
    """
    solution = planned.solution
    found, row, unknown = [], 0, 0
    for motion in planned.phased_motion.motions:
        problem, (points, nz) = motion.problem, motion.z.shape
        nx, count = len(problem.start[0]), problem.stage.balance.numel() + len(problem.path)
        first = row + motion.intervals * (motion.lobatto.points - 1) * nx
        of_rows = solution.multipliers[first : first + points * count].reshape(points, count)
        of_limits = solution.bound_multipliers[unknown : unknown + points * nz].reshape(points, nz).copy()
        of_limits[0, :nx] = 0.0  # the start is no limit
        pull = np.linalg.norm(np.hstack([of_rows, of_limits]), axis=1)
        found.append(pull / (motion.duration_s * motion.lobatto.quadrature(motion.mesh)))
        row, unknown = first + points * count + len(problem.goal), unknown + points * nz + 1
    return np.concatenate(found)
