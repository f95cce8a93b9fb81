"""Drives that jump: segments of a motion between knots whose times are free.

If no cost term smooths the drives, as in minimum time, they jump from limit to limit, which no polynomial
represents. The motion is then cut where its drives change between levels within two intervals, and each piece
becomes a program of its own. States are continuous between pieces, accelerations and drives may jump, and the
pieces' durations are unknowns whose sum is within the plan's limits.

In each interval of a segment drives are linear in time,

    u_nj = (1 - c_j) u_n0 + c_j u_n(s-1)    at the inner nodes c_j.

The positive parts of forces whose magnitudes are a cost are linear too, so that limits at the knots hold in
between. Without this the computed minimum time is too short, because a polynomial exceeds the limits between
its nodes. A drive that is constant between jumps is represented exactly.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.transcription.phase_chain import LinearConstraints
from spacerobot.common.arrays import Array

AT_LIMIT, AT_REST = 0.9, 0.1
"""Shares of a limit above and below which a drive is at its limit or at zero."""
NEAR = 2.0
"""Maximum number of intervals between the two levels of a jump."""
APART = 0.2
"""Minimum distance between jumps, and to the ends, in intervals."""
LEAST = 2
"""Minimum number of intervals of a segment."""
SHORTEST = 1e-4
"""Minimum duration of a segment, as a share of the plan's longest duration."""


def segment_problems(problem: PlanningProblem, count: int) -> list[PlanningProblem]:
    """Problems of segments: each begins at the end of the previous one, and the last one has the goal."""
    greatest = problem.duration[1]
    span = (SHORTEST * greatest, greatest, greatest / count)
    anywhere = (np.full(problem.fixed.size, -np.inf), np.full(problem.fixed.size, np.inf))
    segments = []
    for k in range(count):
        segment = dataclasses.replace(problem, duration=span, linear_drives=True)
        segment = segment if k == 0 else dataclasses.replace(segment, begin=anywhere)
        segments.append(segment if k == count - 1 else dataclasses.replace(segment, goal=(), ends={}))
    return segments


def segment_constraints(
    programs: Sequence[CollocationProgram], problem: PlanningProblem
) -> LinearConstraints:
    """Constraints of all segments: limits of the durations' sum, and linear drives in each interval."""
    sizes = np.cumsum([0, *(program.size for program in programs)])
    rows, columns, values = [np.zeros(len(programs), dtype=int)], [sizes[1:] - 1], [np.ones(len(programs))]
    count = 1
    for first, program in zip(sizes[:-1], programs, strict=True):
        stage, inner, forces = program.problem.stage, program.inner, program.problem.magnitudes.values()
        # of a force and its parts, f = f+ - f-, the third is linear if two are
        positive = [k < each.numel() for each in forces for k in range(2 * each.numel())]
        drives = np.array(stage.drive_places)[[*[True] * stage.u.numel(), *positive]]
        for n in range(program.intervals):
            for j in range(1, inner):
                place = float(program.lobatto.nodes[j])
                for at, weight in ((j, 1.0), (0, place - 1.0), (inner, -place)):
                    rows.append(count + np.arange(len(drives)))
                    columns.append(first + (n * inner + at) * program.nz + drives)
                    values.append(np.full(len(drives), weight))
                count += len(drives)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = sparse.csr_matrix(entries, shape=(count, int(sizes[-1])))
    (least, greatest, _), none = problem.duration, np.zeros(count - 1)
    return LinearConstraints(matrix, np.append(least, none), np.append(greatest, none))


@dataclass(frozen=True)
class DriveJump:
    """A change of a drive from one of its levels to another.

    Attributes:
        share: Time of the jump, as a share of the duration.
        drive: Index of the drive.
        before, after: Levels before and after the jump [N m or N].
    """

    share: float
    drive: int
    before: float
    after: float


def split_at_jumps(phased_motion: PhasedMotion, problem: PlanningProblem) -> PhasedMotion | None:
    """Motion in segments between the jumps of its drives; None if there are no new jumps.

    Args:
        phased_motion: The motion, which may have segments already.
        problem: Problem of the motion.
    """
    pieces = list[Motion]()
    largest = np.max([np.abs(motion.u).max(axis=0) for motion in phased_motion.motions], axis=0)
    for motion in phased_motion.motions:
        jumps = find_jumps(motion, np.minimum(problem.stage.driven.limits, largest))
        least, ends = APART * float(motion.mesh.widths.min()), [0.0]
        for jump in jumps:
            if jump.share - ends[-1] > least and jump.share < 1 - least:
                ends.append(jump.share)
        for begin, end in itertools.pairwise([*ends, 1.0]):
            mesh = motion.mesh
            if len(ends) > 1:
                inside = int(np.count_nonzero((mesh.starts >= begin) & (mesh.starts < end)))
                mesh = Mesh.of(max(LEAST, inside))
            share = begin + (end - begin) * motion.lobatto.times(mesh, 1.0)
            z = motion.along(share)
            drives = motion.parts(z)[3]  # a view
            for jump in jumps:
                near = NEAR * float(motion.mesh.widths.max())
                if begin - least <= jump.share <= begin + least:
                    drives[share < jump.share + near / 2, jump.drive] = jump.after
                if end - least <= jump.share <= end + least:
                    drives[share > jump.share - near / 2, jump.drive] = jump.before
            piece = Motion(problem, motion.lobatto, mesh, (end - begin) * motion.duration_s, z)
            # Accelerations jump with the drives. Without these jumps the initial guess would violate the
            # equations of motion, and the search might end at a worse optimum.
            pieces.append((piece.balanced() if len(ends) > 1 else piece).split_forces())
    if len(pieces) == len(phased_motion.motions):
        return None
    problems = segment_problems(problem, len(pieces))
    return PhasedMotion(
        tuple(dataclasses.replace(m, problem=segment) for m, segment in zip(pieces, problems, strict=True)),
        tuple(np.empty(0) for _ in pieces[1:]),
    )


def find_jumps(motion: Motion, limits: Array) -> list[DriveJump]:
    """Jumps of the drives within a motion, in order of time.

    A drive is at a level if it is near a limit, or near zero for at least one interval.
    """
    share, width, jumps = motion.lobatto.times(motion.mesh, 1.0), motion.mesh.widths, list[DriveJump]()
    for k, limit in enumerate(limits):
        part = motion.u[:, k] / limit if limit > 0 else np.zeros(len(share))
        level = np.where(
            np.abs(part) > AT_LIMIT, np.sign(part), np.where(np.abs(part) < AT_REST, 0.0, np.nan)
        )
        runs = list[tuple[float, int, int]]()  # level, first and last point
        for i in np.flatnonzero(np.isfinite(level)):
            if runs and runs[-1][0] == level[i] and np.isfinite(level[runs[-1][2] : i]).all():
                runs[-1] = (runs[-1][0], runs[-1][1], int(i))
            else:
                runs.append((float(level[i]), int(i), int(i)))
        runs = [run for run in runs if run[0] or share[run[2]] - share[run[1]] >= width.min()]
        for (one, _, last), (other, first, _) in itertools.pairwise(runs):
            middle = (share[last] + share[first]) / 2
            interval = width[motion.mesh.located(np.array([middle]))[0][0]]
            if one != other and share[first] - share[last] <= NEAR * interval:
                jumps.append(DriveJump(float(middle), k, one * limit, other * limit))
    return sorted(jumps, key=lambda jump: jump.share)
