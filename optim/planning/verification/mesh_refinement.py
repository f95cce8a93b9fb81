"""Local mesh refinement: intervals that contribute most to the replay error, or pass a limit, are split.

The error of an interval is measured with the rollouts' own integrator: from the plan's state at the start of
the interval, the plan's torques lead to a state at its end that differs from the plan's. This moves a tip by
e_p and gives it a velocity error e_v. At the end of the plan, a time t later, interval n has therefore
contributed about e_n = e_p + t e_v. Split into m pieces, it contributes e_n / m^p, where p is the order of
the collocation: m local errors of order h^(p + 1), each with h / m.
"""

from __future__ import annotations

import heapq

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import PhasedMotion
from optim.planning.verification.replay import steps_of, tip_errors
from optim.planning.verification.verify import ROUNDING, VerificationResult, between_points
from spacerobot.common.arrays import Array

SAFETY = 0.3
"""Share of the tolerance allowed for the sum of interval errors, because their estimates are asymptotic."""
JUMP = 0.1
"""Change of a force over an interval, relative to the largest force, that counts as a jump."""
PIECES = 4
"""Maximum number of pieces into which one interval is cut at once."""


def refined_meshes(
    phased_motion: PhasedMotion, verification: VerificationResult, max_intervals: int, backend: str = "auto"
) -> tuple[Mesh, ...] | None:
    """Meshes on which the motion is expected to keep its replay tolerance and its limits.

    Args:
        phased_motion, verification: The motion, and its verification.
        max_intervals: Maximum number of intervals of each phase.
        backend: Integrator: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        tuple or None: A mesh for each phase; None if no interval may be split further.
    """
    counts = []
    for motion in phased_motion.motions:  # two pieces where a limit is passed by more than allowed
        pieces = np.ones(motion.intervals, dtype=int)
        for one in between_points(motion):
            passed = one.time_s[one.excess > max(one.allowed, ROUNDING)] / motion.duration_s
            pieces[motion.mesh.located(passed)[0]] = 2
        counts.append(pieces)
    if verification.error_m > verification.tolerance_m:
        errors = local_errors(phased_motion, backend)
        # Errors of intervals may cancel or grow: their sum is scaled to the measured replay error.
        scale = verification.error_m / max(sum(float(phase_errors.sum()) for phase_errors in errors), 1e-300)
        errors = [phase_errors * scale for phase_errors in errors]
        # Add a piece to the interval with the largest contribution until the sum is within the allowed error.
        order = 2 * phased_motion.motions[0].lobatto.points - 2
        rest = [remaining / count**order for remaining, count in zip(errors, counts, strict=True)]
        heap = [(-error, k, n) for k, remaining in enumerate(rest) for n, error in enumerate(remaining)]
        heapq.heapify(heap)
        total = sum(float(remaining.sum()) for remaining in rest)
        while heap and total > SAFETY * verification.tolerance_m:
            error, k, n = heapq.heappop(heap)
            if counts[k][n] >= PIECES:
                continue
            counts[k][n] += 1
            after = errors[k][n] / counts[k][n] ** order
            total += error + after
            heapq.heappush(heap, (-after, k, n))
    meshes = []
    for motion, splits in zip(phased_motion.motions, counts, strict=True):
        room = max_intervals - motion.intervals
        for n in np.argsort(-splits, kind="stable"):  # those that need most pieces first
            splits[n] = min(splits[n], 1 + max(room, 0))
            room -= splits[n] - 1
        meshes.append(motion.mesh.split(splits.tolist()))
    return None if all((splits == 1).all() for splits in counts) else tuple(meshes)


def sharper_meshes(phased_motion: PhasedMotion, max_intervals: int) -> tuple[Mesh, ...] | None:
    """Meshes refined where forces change whose magnitudes are a cost.

    The optimal forces jump from limit to limit. If a jump is represented by a straight line over a time h,
    the impulse is exact but its centroid is off by O(h^2), so that the cost is too large by O(h^2).

    Args:
        phased_motion: The motion.
        max_intervals: Maximum number of intervals of each phase.

    Returns:
        tuple or None: A mesh for each phase; None if there are no such forces, or no interval may be split
            further.
    """
    counts = []
    for motion in phased_motion.motions:
        pieces, room = np.ones(motion.intervals, dtype=int), max_intervals - motion.intervals
        if forces := [*motion.problem.magnitudes.values()]:
            drive = ca.Function("drive", [motion.problem.stage.z], [ca.densify(ca.vertcat(*forces))])
            knots = np.array(drive(motion.z[:: motion.lobatto.points - 1].T).full())
            change = np.abs(np.diff(knots)).max(axis=0) / max(np.abs(knots).max(), 1e-300)
            steepest = np.argsort(-change, kind="stable")[: max(room, 0)]
            pieces[steepest[change[steepest] > JUMP]] = 2
        counts.append(pieces)
    if all((pieces == 1).all() for pieces in counts):
        return None
    return tuple(
        motion.mesh.split(pieces.tolist())
        for motion, pieces in zip(phased_motion.motions, counts, strict=True)
    )


def local_errors(phased_motion: PhasedMotion, backend: str = "auto") -> list[Array]:
    """Distance [m] that each interval contributes to the tips' deviation at the end of the plan (N,).

    Args:
        phased_motion: The motion.
        backend: Integrator: ``auto``, ``compiled`` or ``interpreted``.
    """
    errors = []
    for begin, motion in zip(phased_motion.begins, phased_motion.motions, strict=True):
        stage, step = motion.problem.stage, steps_of(motion, backend)
        model, none = stage.scene.model, np.zeros(2 * len(stage.driven.joints))
        knots = np.hstack([motion.q, motion.v])[:: motion.lobatto.points - 1]
        left = phased_motion.duration_s - begin - motion.duration_s * np.array(motion.mesh.knots[1:])
        states = knots.copy()
        for n in range(motion.intervals):
            state = step(n, knots[n], none)
            drift = left[n] * (state[model.nq :] - knots[n + 1, model.nq :])
            states[n + 1, : model.nq] = pin.integrate(model, state[: model.nq], drift)
        errors.append(np.max([distances[1:] for distances in tip_errors(motion, states).values()], axis=0))
    return errors
