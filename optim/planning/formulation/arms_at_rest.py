"""Arms that are settled where a plan ends: joints move no more than their tips' motion takes.

Of all joint rates r that give the tips their twists J r, relative to the base, the smallest ones are
J^T (J J^T)^-1 J r. As many rows of their difference to r as the arm has joints to spare are zero; the others
follow. Nor do joints accelerate, so that the torques end near zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
from scipy.linalg import qr

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.goal import Goal
from spacerobot.elements.plan_instant import BoundedRow, zero


def rest_rows(stage: Stage, goals: Mapping[str, Goal]) -> Iterator[BoundedRow]:
    """Rows of the robots whose goals ask for it."""
    twists = dict[str, list[ca.SX]]()
    for name, goal in goals.items():
        twist = goal.settling(InstantView(stage, f"plan.goals.{name}"))
        if twist is not None:
            twists.setdefault(goal.body, []).append(twist)
    for robot, own in twists.items():
        yield from _settled(stage, robot, ca.vertcat(*own))


def _settled(stage: Stage, robot: str, twist: ca.SX) -> Iterator[BoundedRow]:
    """Rows of one robot."""
    model = stage.scene.model
    joints = next(body for body in stage.scene.bodies if body.name == robot).driven_joints
    columns = [int(model.idx_vs[joint]) for joint in joints]
    names, rates = [model.names[joint] for joint in joints], stage.v[columns]
    for name, acceleration in zip(names, ca.vertsplit(stage.a[columns]), strict=True):
        yield zero(f"settled: acceleration of {name}", "rad/s2 or m/s2", acceleration)
    slopes = ca.densify(ca.jacobian(twist, stage.v)[:, columns])
    taken, count = slopes.shape
    if taken >= count:
        return
    least = ca.mtimes(slopes.T, SymmetricFactors(ca.mtimes(slopes, slopes.T)).solve(ca.mtimes(slopes, rates)))
    first = ca.Function("slopes", [stage.q], [slopes])(stage.scene.q).full()
    for k in sorted(qr(first, pivoting=True, mode="r")[1][taken:].tolist()):
        yield zero(f"settled: spare rate of {names[k]}", "rad/s or m/s", rates[k] - least[k])
