"""Residuals of the first-order conditions at a point, whichever method found it."""

from __future__ import annotations

import numpy as np

from optim.problem.problem import Form, Linearisation
from spacerobot.common.arrays import Array

NEAR_BOUND = 1e-3  # of the unit cube
NEAR_PEAK = 2e-3  # of the largest row: what is nearer counts as active, so a point is judged to this accuracy
NEAR_LIMIT = 1e-3  # of a constraint's limit
HEAVY = 1e3  # weight that makes multipliers of a minimax problem sum to one


def kkt_residual(u: Array, at: Linearisation, form: Form) -> float:
    """Norm of the Lagrangian's gradient with the best multipliers, relative to the objective.

    It is the fraction by which the objective would fall, to first order, for a step of length one in the unit
    cube along the steepest direction that bounds and constraints allow.

    Args:
        u: The point (k,).
        at: Values and derivatives there.
        form: Form of the objective.
    """
    from scipy.optimize import nnls

    k, scale = len(u), max(abs(at.objective), np.finfo(float).tiny)
    eye = np.eye(k)
    sides = [-eye[u <= NEAR_BOUND], eye[u >= 1 - NEAR_BOUND]]
    sides.append(at.constraint_jacobian[at.constraints >= -NEAR_LIMIT])
    pushing = np.concatenate(sides)
    if form != "minimax":
        if not len(pushing):
            return float(np.linalg.norm(at.gradient) / scale)
        return float(nnls(pushing.T, -at.gradient / scale)[1])
    peaks = at.rows_jacobian[at.rows >= at.rows.max() - NEAR_PEAK * abs(at.rows.max())] / scale
    weights = np.concatenate([np.ones(len(peaks)), np.zeros(len(pushing))])
    matrix = np.vstack([np.concatenate([peaks, pushing]).T, HEAVY * weights])
    return float(nnls(matrix, np.append(-at.smooth_gradient / scale, HEAVY))[1])
