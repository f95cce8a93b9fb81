"""Transfer of solutions between meshes: a fine mesh is solved from the solution on a coarse one."""

from __future__ import annotations

import dataclasses

import numpy as np

from optim.planning.solver.ipopt import OnIteration, Solution, solve
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.motion import Motion
from optim.planning.transcription.phase_chain import PhaseChain
from spacerobot.common.arrays import Array


def solve_from(
    motion: Motion,
    program: CollocationProgram,
    *,
    scale: float,
    iterations: int = 500,
    on_iteration: OnIteration | None = None,
) -> tuple[Solution, Solution]:
    """Solve a problem on a motion's mesh, then on the program's mesh from that solution.

    Args:
        motion: Initial motion, on a coarse mesh.
        program: Program to be solved.
        scale, iterations, on_iteration: Options of :func:`solve`; iterations on each mesh.

    Returns:
        tuple: Solutions on the coarse mesh, and on the program's.
    """
    coarse = CollocationProgram(program.problem, program.instants, motion.lobatto, motion.mesh)
    coarse_solution = solve(
        coarse, motion.unknowns, scale=scale, iterations=iterations, on_iteration=on_iteration
    )
    z, duration = coarse.split(coarse_solution.w)
    near = dataclasses.replace(motion, z=z, duration_s=duration).on(program.lobatto, program.mesh)
    warm = transfer_remaining(coarse_solution, coarse, program) if coarse_solution.converged else None
    return coarse_solution, solve(
        program, near.unknowns, warm, scale=scale, iterations=iterations, on_iteration=on_iteration
    )


def transfer(solution: Solution, source: PhaseChain, target: PhaseChain) -> Solution:
    """Transfer a solution from one mesh to another of the same problem.

    Multipliers of constraints at points are densities over time times the quadrature weights. Those of the
    defects of an interval follow from the costates p by A^T lambda = b p.

    Args:
        solution: Solution on the source's mesh.
        source, target: Program of the solution, and the program to be solved. Unknowns are not carried over.
    """
    parts = source.parted(solution)
    of = zip(parts, source.programs, target.programs, strict=False)
    parts[: len(source.programs)] = [transfer_remaining(*one) for one in of]
    return dataclasses.replace(
        solution,
        multipliers=np.concatenate([*(part.multipliers for part in parts), np.zeros(len(target.rest.least))]),
        bound_multipliers=np.concatenate([part.bound_multipliers for part in parts]),
    )


def transfer_constrained(solution: Solution, source: PhaseChain, target: PhaseChain) -> Solution:
    """Transfer a solution to the same problem and mesh with further path constraints.

    Args:
        solution: Solution of the source.
        source, target: Program of the solution, and one whose path has all rows of the source's in the same
            order, and further rows of other names, whose multipliers are zero.
    """
    blocks = list[Array]()
    for part, old, new in zip(source.parted(solution), source.programs, target.programs, strict=False):
        last = old.rows - len(old.problem.goal)
        held = part.multipliers[old.defects : last].reshape(old.points, -1)
        values, k = np.zeros((new.points, new.per_point)), new.nv
        values[:, : new.nv] = held[:, : old.nv]
        for column, row in enumerate(new.problem.path, start=new.nv):
            if k < old.per_point and row.name == old.problem.path[k - old.nv].name:
                values[:, column] = held[:, k]
                k += 1
        blocks.append(
            np.concatenate([part.multipliers[: old.defects], values.ravel(), part.multipliers[last:]])
        )
    blocks.append(solution.multipliers[sum(one.rows for one in source.programs) :])  # of links
    return dataclasses.replace(solution, multipliers=np.concatenate(blocks))


def transfer_remaining(
    solution: Solution, source: CollocationProgram, target: CollocationProgram, begin: float = 0.0
) -> Solution:
    """Transfer the rest of a phase's solution to another mesh.

    Args:
        solution, source, target: See :func:`transfer`.
        begin: Share of the source's duration at which the target begins; both end at the same time.
    """
    left = 1.0 - begin
    share, target_share = (at.lobatto.times(at.mesh, 1.0) for at in (source, target))
    target_share = begin + left * target_share
    between = np.array([np.interp(target_share, share, unit) for unit in np.eye(len(share))]).T
    weights = left * target.weights[:, None] * between / source.weights
    last = source.rows - len(source.problem.goal)
    held = weights @ solution.multipliers[source.defects : last].reshape(source.points, -1)
    bounds = weights @ solution.bound_multipliers[:-1].reshape(source.points, -1)
    if source.problem.begin is None:
        bounds[0, : target.nx] = 0.0  # the start is no unknown
    # multipliers of the target's defects (N, s - 1, nx)
    defect_multipliers = solution.multipliers[: source.defects].reshape(
        source.intervals, source.inner, source.nx
    )
    lobatto, other = source.lobatto, target.lobatto
    costates = np.einsum("jk,njx->nkx", lobatto.integral[1:], defect_multipliers) / lobatto.weights[:, None]
    starts, widths = (begin + (1.0 - begin) * target.mesh.starts), (1.0 - begin) * target.mesh.widths
    inside = source.mesh.located(starts + widths / 2)[0]  # one polynomial for all points of an interval
    places = starts[:, None] + widths[:, None] * other.nodes - source.mesh.starts[inside, None]
    values = lobatto.values_at(places / source.mesh.widths[inside, None])  # (N, s, points of the source)
    p = np.einsum("nik,nkx->nix", values, costates[inside])
    back = np.linalg.pinv(other.integral[1:].T)
    defects = np.asarray(np.einsum("jk,nkx->njx", back, other.weights[:, None] * p))
    return dataclasses.replace(
        solution,
        multipliers=np.concatenate([defects.ravel(), held.ravel(), solution.multipliers[last:]]),
        bound_multipliers=np.append(bounds, solution.bound_multipliers[-1]),
    )
