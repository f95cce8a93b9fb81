"""Reachability of the goals, checked by inverse kinematics before a solver runs.

A free-floating robot moves its base by moving its arm, but its centre of mass moves uniformly. A posture in
which a motion may end therefore has joints within their ranges and arbitrary base placements, such that

    r(q) = 0 (poses and postures of the goals),    c(q) = c(t) (centres of mass of floating robots),
    l <= p(q) <= u (path constraints that depend on the configuration alone).

The attitude of a base is free, because it depends on the path of the joints. A goal that no posture meets is
reached by no motion. The Levenberg-Marquardt method minimises the sum of squares from several postures; if
the duration is free, the instant t within its limits is an unknown too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.initial_guess import base_shifts, drift, inverse_kinematics, is_guided
from optim.planning.transcription.lobatto import Lobatto
from spacerobot.common.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow

POSTURES = 20
"""Number of postures from which inverse kinematics starts."""
INSTANTS = 50
"""Number of intervals on which the free motion of the target is interpolated."""
STEPS = 60
"""Maximum number of steps of one search for a posture."""
MET, MISSED = 1e-6, 1e-4
"""Residual below which a goal is met, and above which it is refused [m, rad]."""
FIRM = 30.0
"""Weight of the rows of centres of mass relative to those of goals, so that only goals are missed."""
NAMED = 3
"""Maximum number of missed goals that the message names."""


def check_posture(problem: PlanningProblem) -> None:
    """Refuse goals that no posture of the robots reaches.

    Args:
        problem: Problem of the first phase; the check is skipped if its start is free or grasps hold.

    Raises:
        ScenarioError: If a goal is out of reach; the message states the smallest distance.
    """
    if problem.begin is not None or problem.stage.grips or problem.stage.springs:
        return
    stage = problem.stage
    moving = ca.vertcat(stage.v, stage.a, stage.u, stage.w, stage.s)
    goals = [row for row in problem.goal if not ca.depends_on(row.value, moving)]
    if not goals:
        return
    search = _Postures(problem, goals, moving)
    nearest, misses = np.inf, dict[str, tuple[float, str]]()
    for posture in search.starts():
        size, end_posture = search.run(posture)
        if size < nearest:
            nearest, misses = size, search.misses(end_posture)
        if nearest < MET:
            return
    missed = {name: one for name, one in misses.items() if one[0] > MISSED}
    if not missed:
        return
    first = {row.name for row in problem.goal} & missed.keys() or missed.keys()
    worst = sorted(first, key=lambda name: -missed[name][0])[:NAMED]
    words = ", ".join(f"{name} by {missed[name][0]:.2g} {missed[name][1]}" for name in worst)
    raise problem.stage.scene.error(
        f"out of reach: the nearest posture that inverse kinematics found from {POSTURES} postures misses "
        f"{words}; bring the object nearer, or change the goal or the limits of joints and bases",
        "plan.goals",
    )


class _Postures:
    """Inverse kinematics of all robots for goals that depend on the configuration alone.

    A posture is a configuration and its time, as a share of the longest duration.
    """

    def __init__(self, problem: PlanningProblem, goals: Sequence[BoundedRow], moving: ca.SX) -> None:
        stage, model = problem.stage, problem.stage.scene.model
        self.problem = problem
        # distances between shapes are left out: their derivatives take longer than all else
        path = [
            row
            for row in problem.path
            if row.about is None and not row.first and not ca.depends_on(row.value, moving)
        ]
        self.rows = (*goals, *path)
        # values at a configuration, and their derivatives by all velocities
        value = ca.densify(ca.vertcat(*(row.value for row in self.rows)))
        slopes = ca.mtimes(ca.jacobian(value, stage.q), ca.jacobian(stage.rate, stage.v))
        self.values = ca.Function("posture", [stage.q], [value, ca.densify(slopes)], {"cse": True})
        # velocities along which the posture is searched, and roots of robots whose centres of mass drift
        self.columns, self.floating = list(stage.driven.columns[: len(stage.driven.joints)]), list[int]()
        for body in stage.scene.robots:
            if body.root_joint:
                first = int(model.idx_vs[body.root_joint])
                self.columns += range(first, first + int(model.nvs[body.root_joint]))
                if not stage.driven.strength(body.name, "f"):
                    self.floating.append(body.root_joint)
        # configurations (INSTANTS + 1, nq) and velocities of free drift over the longest duration
        self.drift = drift(problem, Lobatto.of_order(2), INSTANTS, problem.duration[1])

    def starts(self) -> Iterator[tuple[Array, float]]:
        """Initial postures: the scenario's, then random ones, at instants between the duration's limits."""
        model, (least, greatest, guessed) = self.problem.stage.scene.model, self.problem.duration
        rng, (lower, upper) = np.random.default_rng(0), self._sides
        if is_guided(self.problem):  # from the goal's place at the target, which is far from the start
            part = float(guessed) / greatest
            q = self._at(self.drift[0][0], part, np.ones(model.nv, dtype=bool))
            speeds = self.drift[1][round(part * INSTANTS)]
            yield inverse_kinematics(self.problem, q, speeds, self.columns), part
        for k in range(POSTURES):
            part = float(guessed if k == 0 else rng.uniform(least, greatest)) / greatest
            q = self._at(self.drift[0][0], part, np.ones(model.nv, dtype=bool))
            step = np.zeros(model.nv)
            for joint in self.problem.stage.driven.joints if k else ():
                joint_model = model.joints[joint]
                low, high = max(lower[joint_model.idx_q], -np.pi), min(upper[joint_model.idx_q], np.pi)
                bounded = joint_model.nq == 1
                step[joint_model.idx_v] = (
                    rng.uniform(low, high) - q[joint_model.idx_q] if bounded else rng.uniform(-np.pi, np.pi)
                )
            yield self._clipped(pin.integrate(model, q, step)), part

    def run(self, posture: tuple[Array, float]) -> tuple[float, tuple[Array, float]]:
        """Smallest violation norm in a search from a posture, and the posture that has it."""
        model, (least, greatest, _) = self.problem.stage.scene.model, self.problem.duration
        (q, part), (lower, upper), damping = posture, self._sides, 1e-2
        drifting, shifts = np.ones(model.nv, dtype=bool), base_shifts(self.problem)
        drifting[self.columns] = False
        off, slopes = self._residual(q, part)
        for _ in range(STEPS):
            if np.linalg.norm(off) < MET / 10 or damping > 1e8:
                break
            # a joint at the end of its range only moves inwards; the same holds for the instant
            pull = -slopes.T @ off
            bound = np.zeros(model.nv, dtype=np.int64)  # 1 at an upper limit, -1 at a lower one, else 0
            for joint in self.problem.stage.driven.joints:
                place = model.joints[joint].idx_q
                if model.joints[joint].nq == 1:
                    at_ends = int(q[place] >= upper[place]) - int(q[place] <= lower[place])
                    bound[model.joints[joint].idx_v] = at_ends
            held = np.append(bound[self.columns], int(part >= 1.0) - int(part <= least / greatest))
            free = ~((held != 0) & (np.sign(pull) == held))
            free[-1] &= least < greatest
            jacobian, step = slopes[:, free], np.zeros(len(pull))
            # as least squares: with large slopes the normal equations are singular to rounding
            rows = np.vstack([jacobian, np.sqrt(damping) * np.eye(jacobian.shape[1])])
            right = np.append(-off, np.zeros(jacobian.shape[1]))
            step[free] = np.linalg.lstsq(rows, right, rcond=None)[0]
            limited = [column not in shifts for column in (*self.columns, -1)]
            step /= max(1.0, np.abs(step[limited]).max())
            along = np.zeros(model.nv)
            along[self.columns] = step[:-1]
            later = float(np.clip(part + step[-1], least / greatest, 1.0))
            other = self._at(self._clipped(pin.integrate(model, q, along)), later, drifting)
            residual, after = self._residual(other, later)
            if np.linalg.norm(residual) < np.linalg.norm(off):
                q, part, off, slopes, damping = other, later, residual, after, max(damping / 10, 1e-9)
            else:
                damping *= 10
        return float(np.linalg.norm(off)), (q, part)

    def misses(self, posture: tuple[Array, float]) -> dict[str, tuple[float, str]]:
        """Violations of a posture by name, each with its unit."""
        values = np.array(self.values(posture[0])[0]).ravel()
        rows = zip(self.rows, values, strict=True)
        return {
            row.name: (max(row.lower - value, value - row.upper, 0.0) * row.scale, row.unit)
            for row, value in rows
        }

    def _residual(self, q: Array, part: float) -> tuple[Array, Array]:
        """Residual (n,) of a posture, and its derivatives by the free coordinates and by the time (n, k + 1).

        Rows of constraints are zero where the limits hold; the last rows compare centres of mass.
        """
        lower, upper = (np.array([getattr(row, key) for row in self.rows]) for key in ("lower", "upper"))
        scale = np.array([row.scale for row in self.rows])
        value, slopes = (np.array(x) for x in self.values(q))
        over = np.maximum(value.ravel() - upper, 0.0) - np.maximum(lower - value.ravel(), 0.0)
        slopes = slopes * (scale * ((over != 0) | (lower == upper)))[:, None]
        k, _ = self._instant(part)
        rate = self.problem.duration[1] * self.drift[1][k]
        drifting = rate.copy()
        drifting[self.columns] = 0.0
        centres, of_centres = self._centres(q)
        drift_q = self._at(self.drift[0][0], part, np.ones(len(rate), dtype=bool))
        drift_centres, of_drift = self._centres(drift_q)
        return (
            np.concatenate([scale * over, FIRM * (centres - drift_centres)]),
            np.block(
                [
                    [slopes[:, self.columns], (slopes @ drifting)[:, None]],
                    [FIRM * of_centres[:, self.columns], -FIRM * (of_drift @ rate)[:, None]],
                ]
            ),
        )

    def _instant(self, part: float) -> tuple[int, float]:
        """Interval of the free motion at a share of the longest duration, and the place in it."""
        k = min(int(part * INSTANTS), INSTANTS - 1)
        return k, part * INSTANTS - k

    def _at(self, q: Array, part: float, drifting: npt.NDArray[np.bool_]) -> Array:
        """Configuration with ``drifting`` coordinates replaced by their free drift at a time share."""
        model, (k, place), qs = self.problem.stage.scene.model, self._instant(part), self.drift[0]
        free, q = pin.interpolate(model, qs[k], qs[k + 1], place), q.copy()
        for joint in list(model.joints)[1:]:
            if drifting[joint.idx_v]:
                q[joint.idx_q : joint.idx_q + joint.nq] = free[joint.idx_q : joint.idx_q + joint.nq]
        return q

    def _centres(self, q: Array) -> tuple[Array, Array]:
        """Centres of mass of floating robots (3 robots,) [m], and their derivatives (3 robots, nv)."""
        model = self.problem.stage.scene.model
        data, places, slopes = model.createData(), [np.zeros(0)], [np.zeros((0, model.nv))]
        for root in self.floating:
            slopes.append(pin.jacobianSubtreeCenterOfMass(model, data, q, root))
            places.append(data.com[root].copy())  # in world axes, after the line above
        return np.concatenate(places), np.vstack(slopes)

    @property
    def _sides(self) -> tuple[Array, Array]:
        nq = self.problem.stage.scene.model.nq
        return self.problem.lower[:nq], self.problem.upper[:nq]

    def _clipped(self, q: Array) -> Array:
        """Return a configuration with joints clipped to their ranges."""
        return np.clip(q, *self._sides)
