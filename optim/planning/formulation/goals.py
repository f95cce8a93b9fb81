"""Goals as rows that vanish at the last instant, and arms that are settled there.

Joints of a settled arm move no more than their tips' motion takes. Of all joint rates r that give the tips
their twists J r, relative to the base, the smallest ones are J^T (J J^T)^-1 J r. As many rows of their
difference to r as the arm has joints to spare are zero; the others follow. Nor do joints accelerate, so that
the torques end near zero.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import casadi as ca
from scipy.linalg import qr

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, zero


def goal_rows(stage: Stage, goals: Mapping[str, Goal]) -> Iterator[BoundedRow]:
    """Rows of goals, and of robots that they require to be settled.

    Raises
    ------
    ScenarioError
        If one names an unknown body, link or joint.
    """
    model, bodies = stage.scene.model, {body.name: body for body in stage.scene.bodies}
    twists = dict[str, list[ca.SX]]()
    for name, goal in goals.items():
        view = InstantView(stage, f"plan.goals.{name}")
        for row in goal.rows(view):
            yield dataclasses.replace(row, name=f"{name}: {row.name}")
        most = goal.rate_within
        for j in bodies[goal.body].driven_joints if goal.rests else ():
            rate = f"{name}: rate of {model.names[j]}"
            yield BoundedRow(rate, "rad/s or m/s", stage.v[model.idx_vs[j]], -most, most)
        twist = goal.settling(view)
        if twist is not None:
            twists.setdefault(goal.body, []).append(twist)
    for robot, own in twists.items():
        joints = bodies[robot].driven_joints
        columns = [int(model.idx_vs[joint]) for joint in joints]
        names, rates = [model.names[joint] for joint in joints], stage.v[columns]
        for name, acceleration in zip(names, ca.vertsplit(stage.a[columns]), strict=True):
            yield zero(f"settled: acceleration of {name}", "rad/s2 or m/s2", acceleration)
        slopes = ca.densify(ca.jacobian(ca.vertcat(*own), stage.v)[:, columns])
        taken, count = slopes.shape
        if taken >= count:
            continue
        least = ca.mtimes(
            slopes.T, SymmetricFactors(ca.mtimes(slopes, slopes.T)).solve(ca.mtimes(slopes, rates))
        )
        first = ca.Function("slopes", [stage.q], [slopes])(stage.scene.q).full()
        for k in sorted(qr(first, pivoting=True, mode="r")[1][taken:].tolist()):
            yield zero(f"settled: spare rate of {names[k]}", "rad/s or m/s", rates[k] - least[k])
