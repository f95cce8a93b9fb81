"""Second-order conditions: search for a feasible direction of descent at a solution.

At a solution with multipliers, let H be the Hessian of the Lagrangian, J the Jacobian of the constraints, and
D > 0 the diagonal stiffness of the constraints. An equation has a large stiffness. A limit has its multiplier
divided by its slack: an active limit acts as an equation, an inactive one has no effect. The solution is a
minimum if the KKT matrix

    [ H   J'     ]
    [ J  -1/D    ]

has as many negative eigenvalues as constraints (Nocedal and Wright, *Numerical Optimization*, section 16.3).
Elimination of the lower right block shows that this holds if and only if H + J' D J is positive definite,
which an LDL' factorisation without pivoting tests: the factorisation exists with positive pivots for positive
definite matrices only.

Curvatures are measured relative to W, a diagonal matrix with the share of the duration that belongs to each
unknown: d' H d / d' W d is the second derivative of the cost along a motion of mean square one.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.phase_chain import PhaseChain
from spacerobot.common.arrays import Array

FLAT = 1e-3
"""Curvature relative to the cost below which a direction is flat: plans may have several equal optima."""
EQUATION = 1e8
"""Stiffness of an equation, and maximum stiffness of a limit, relative to the cost."""
STEPS = 30
"""Number of steps of the inverse iteration."""


def descent_direction(program: PhaseChain, solution: Solution, scale: float) -> Array | None:
    """Direction (size,) along which the cost falls to second order and the constraints hold to first.

    None if the solution is a minimum. Its mean square over the duration is one.

    Args:
        program, solution: Program, and its solution.
        scale: Size of the cost.
    """
    w, (low, high), (least, greatest) = solution.w, program.bounds(), program.limits()
    pattern = program.hessian_pattern
    upper = sparse.csc_matrix(
        (program.hessian(w, 1.0, solution.multipliers), pattern.indices, pattern.indptr), shape=pattern.shape
    )
    pattern = program.jacobian_pattern
    slopes = sparse.csc_matrix((program.jacobian(w), pattern.indices, pattern.indptr), shape=pattern.shape)
    stiff = _stiffness(program.constraints(w), least, greatest, solution.multipliers, EQUATION * scale)
    sizes = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=1)).ravel())
    equal = least == greatest
    stiff[equal] /= np.maximum(sizes[equal], 1e-12) ** 2
    held = _stiffness(w, low, high, solution.bound_multipliers, EQUATION * scale)
    # diagonal of W: share of the duration for each unknown, one for durations, zero for fixed unknowns
    parts = np.concatenate([np.append(np.repeat(one.weights, one.nz), 1.0) for one in program.programs])
    weights = np.concatenate([parts, np.ones(program.size)])[: program.size]
    weights[low == high] = 0.0
    held[low == high] = 0.0
    hessian = upper + sparse.triu(upper, 1).T
    matrix = (hessian + sparse.diags(held) + slopes.T @ sparse.diags(stiff) @ slopes).tocsc()  # H + J' D J
    free = np.flatnonzero(weights)
    matrix, metric = matrix[free][:, free].tocsc(), sparse.diags(weights[free], format="csc")
    if _positive(matrix + FLAT * scale * metric) is not None:
        return None
    shift = FLAT * scale
    for _ in range(60):
        shift *= 4
        factors = _positive(matrix + shift * metric)
        if factors is not None:
            break
    else:
        return None  # no number: the problem's derivatives are at fault
    direction = np.random.default_rng(0).standard_normal(len(free))
    for _ in range(STEPS):
        direction = factors.solve(metric @ direction)
        direction /= np.sqrt(direction @ (metric @ direction))
    if not direction @ (matrix @ direction) < -FLAT * scale / 2:
        return None
    out = np.zeros(program.size)
    out[free] = direction
    return out


def _stiffness(values: Array, least: Array, greatest: Array, multipliers: Array, most: float) -> Array:
    """Stiffness of each constraint: multiplier over slack of a limit, at most ``most``.

    ``most`` for equations.
    """
    room = np.where(multipliers > 0, greatest - values, values - least)
    with np.errstate(divide="ignore", invalid="ignore"):
        stiffness = np.abs(multipliers) / np.maximum(room, 0.0)
    stiffness = np.where(np.isfinite(room), np.nan_to_num(stiffness, nan=0.0, posinf=most), 0.0)
    return np.where(least == greatest, most, np.minimum(stiffness, most))


def _positive(matrix: sparse.csc_matrix) -> SuperLU | None:
    """Factors of a symmetric matrix; None if it is not positive definite."""
    try:
        factors = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )
    except RuntimeError:  # singular
        return None
    same = np.array_equal(factors.perm_r, factors.perm_c)
    return factors if same and (factors.U.diagonal() > 0).all() else None
