"""Goals as constraints at the last instant, and arms that are settled there.

A settled arm has no motion in its null space. Among all joint rates r that give the tips the twists J r
relative to the base, J^T (J J^T)^-1 J r has the smallest norm. The difference between r and these rates is
constrained to zero, in as many rows as the arm has redundant joints; the other rows follow from these. Joint
accelerations are zero too, so that torques end near zero.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np
from scipy.linalg import orth, qr

from optim.planning.formulation.grasps import tip_slip
from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, zero

DEPENDENT = 1e-6
"""Part of a unit velocity outside the span of constrained ones, below which it is dependent on them."""


def goal_rows(stage: Stage, goals: Mapping[str, Goal]) -> Iterator[BoundedRow]:
    """Rows of goals, and of robots that they require to be settled.

    Raises:
        ScenarioError: If one names an unknown body, link or joint.
    """
    model, bodies = stage.scene.model, {body.name: body for body in stage.scene.bodies}
    twists = dict[str, list[ca.SX]]()
    for name, goal in goals.items():
        view = InstantView(stage, f"plan.goals.{name}")
        yield from (
            dataclasses.replace(row, name=f"{name}: {row.name}") for row in _own_rows(stage, view, goal)
        )
        twist = goal.settling(view)
        if twist is not None:
            twists.setdefault(goal.body, []).append(twist)
    for robot, components in twists.items():
        joints = bodies[robot].driven_joints
        columns = [int(model.idx_vs[joint]) for joint in joints]
        names, rates = [model.names[joint] for joint in joints], stage.v[columns]
        for name, acceleration in zip(names, ca.vertsplit(stage.a[columns]), strict=True):
            yield zero(f"settled: acceleration of {name}", "rad/s2 or m/s2", acceleration)
        slopes = ca.densify(ca.jacobian(ca.vertcat(*components), stage.v)[:, columns])
        rank, count = slopes.shape
        if rank >= count:
            continue
        least = ca.mtimes(
            slopes.T, SymmetricFactors(ca.mtimes(slopes, slopes.T)).solve(ca.mtimes(slopes, rates))
        )
        first = ca.Function("slopes", [stage.q], [slopes])(stage.scene.q).full()
        for k in sorted(qr(first, pivoting=True, mode="r")[1][rank:].tolist()):
            yield zero(f"settled: spare rate of {names[k]}", "rad/s or m/s", rates[k] - least[k])


def _own_rows(stage: Stage, view: InstantView, goal: Goal) -> Iterator[BoundedRow]:
    """Constraints of a goal, of joints that it requires to rest, and of bodies joined with its own.

    Rigid grasps keep A(q) v = 0, so velocity constraints may be dependent. A base is at rest if its joints
    and the welded object are; an object is at rest if the joints of the fixed-base robot that holds it are.
    Dependent constraints are left out; dependence is tested with A at the scene's configuration.
    """
    model, most = stage.scene.model, goal.rate_within
    bodies = {body.name: body for body in stage.scene.bodies}
    resting = {one.body: one for one in goal.resting(view)}
    # an unknown body has no joints here; the goal's constraints report the error
    joints = [joint for body in resting if body in bodies for joint in bodies[body].driven_joints]
    rates = [
        BoundedRow(f"rate of {model.names[j]}", "rad/s or m/s", stage.v[model.idx_vs[j]], -most, most)
        for j in joints
    ]
    if len(resting) < 2:
        yield from (*goal.rows(view), *rates)
        return
    held = ca.densify(ca.jacobian(tip_slip(stage.scene, stage.kinematics, stage.grips), stage.v))
    basis = orth(ca.Function("held", [stage.q], [held])(stage.scene.q).full().T)

    def is_independent(column: int) -> bool:
        """Whether a velocity is independent of A and of earlier constrained ones; if so, it joins them."""
        nonlocal basis
        rest = np.eye(model.nv)[column] - basis @ basis[column]
        size = float(np.linalg.norm(rest))
        if size > DEPENDENT:
            basis = np.column_stack([basis, rest / size])
        return size > DEPENDENT

    free = [is_independent(int(model.idx_vs[joint])) for joint in joints]
    rates = [row for row, is_free in zip(rates, free, strict=True) if is_free or most]
    roots = list[list[BoundedRow]]()  # of each body, the goal's own first
    for body, one in resting.items():
        root = bodies[body].root_joint
        first, size = (int(model.idx_vs[root]), int(model.nvs[root])) if root else (0, 0)
        free = [is_independent(first + k) for k in range(size)]
        rows = [*one.rows(view)] if root else []
        exact = len(rows) == len(free) and all(row.lower == row.upper for row in rows)
        if exact and not most:  # one row for each velocity
            rows = [row for row, is_free in zip(rows, free, strict=True) if is_free]
        elif body != goal.body and not any(free):  # with a tolerance rows of other bodies follow roughly
            rows = []
        of = "" if body == goal.body else f" of {body}"
        roots.append([dataclasses.replace(row, name=row.name + of) for row in rows])
    yield from itertools.chain(roots[0], rates, *roots[1:])
