"""What is refused before a solver runs: a start that violates its own limits, a goal that no arm reaches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.goals import Seen
from optim.planning.guess import drift
from optim.planning.limits import urdf_joint
from optim.planning.lobatto import Lobatto
from optim.planning.stage import Problem
from spacerobot.arrays import Array
from spacerobot.elements.goal import TipGoal
from spacerobot.elements.goals.still import Still
from spacerobot.errors import ScenarioError
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene
from spacerobot.scene.reach import reach
from spacerobot.scene.scene import SceneBody, SceneTip

SLACK = 1e-9
"""Violation of a start that is rounding."""
INSTANTS = 100
"""Instants of a free duration at which a moving goal is looked for."""


def check_start(problem: Problem) -> None:
    """Refuse a start that is given and violates its own limits.

    Raises
    ------
    ScenarioError
        Naming the limit.
    """
    if problem.begin is not None:
        return
    scene, driven = problem.stage.scene, problem.stage.driven
    model = scene.model
    for joint in driven.joints:
        own, name = model.joints[joint], str(model.names[joint])
        checked = [("rate", model.nq + own.idx_v, "rad/s or m/s")]
        if own.nq == 1:
            checked.append(("position", own.idx_q, "rad or m"))
        for what, place, unit in checked:
            least, greatest = problem.lower[place], problem.upper[place]
            if not least - SLACK <= problem.fixed[place] <= greatest + SLACK:
                raise ScenarioError(
                    f"the start violates a limit: the {what} of {name} is {problem.fixed[place]:.4g}, "
                    f"allowed {least:.4g} to {greatest:.4g} {unit}; begin elsewhere or change the limit",
                    source=scene.source,
                    where="plan",
                )
    stage = problem.stage
    later = ca.vertcat(stage.a, stage.u, stage.w)
    rows = [row for row in problem.path if row.last == 1.0 and not ca.depends_on(row.value, later)]
    if not rows:
        return
    rest = np.zeros(problem.stage.z.numel() - len(problem.fixed))
    values = ca.Function("start", [problem.stage.z], [ca.densify(ca.vertcat(*(row.value for row in rows)))])
    found = np.array(values(np.concatenate([problem.fixed, rest]))).ravel()
    for row, value in zip(rows, found, strict=True):
        if not row.lower - SLACK <= value <= row.upper + SLACK:
            over = max(row.lower - value, value - row.upper) * row.scale
            raise ScenarioError(
                f"the start violates a limit: {row.name} is passed by {over:.4g} {row.unit}; begin elsewhere "
                "or change the limit",
                source=scene.source,
                where="plan",
            )


def check_momentum(problem: Problem, plan: Planning) -> None:
    """Refuse that bodies come to rest whose momentum nothing takes, or that are told to twice.

    Raises
    ------
    ScenarioError
        With that momentum.
    """
    scene, limits, resting = problem.stage.scene, plan.limits, dict[str, str]()
    for name, goal in plan.goals.items():
        if not isinstance(goal, Still) or not goal.rests:
            continue
        where = f"plan.goals.{name}"
        body = next(body for body in scene.bodies if body.name == goal.still)
        group = _moving_with(problem, body)
        if body.name in resting:
            raise ScenarioError(
                f"{body.name} comes to rest by goal {resting[body.name]!r} already, by a weld; leave "
                "one of the two out",
                source=scene.source,
                where=where,
            )
        if problem.stage.springs:
            continue  # they may take it
        names = {one.name for one in group}
        resting |= dict.fromkeys(names, name)
        if names == {"target"}:
            told = "moves on as it does, for nothing holds it"
            raise ScenarioError(f"{body.name} {told}", source=scene.source, where=where)
        linear, angular = (float(np.linalg.norm(found)) for found in _momenta(scene, group))
        for size, unit, key, able in (
            (linear, "N s", "base_force", limits.base_force > 0),
            (angular, "N m s", "base_torque", limits.base_force + limits.base_torque > 0),
        ):
            if size > SLACK and not able:
                raise ScenarioError(
                    f"{body.name} cannot come to rest, for nothing takes its momentum of {size:.4g} {unit}; "
                    f"give `limits.{key}`",
                    source=scene.source,
                    where=where,
                )


def _moving_with(problem: Problem, body: SceneBody) -> list[SceneBody]:
    """A body, and those that welds join with it."""
    target = problem.stage.scene.target
    holding = {
        grip.tip.body.name: grip.tip.body for grip in problem.stage.grips if grip.config.fixes_orientation
    }
    if target is None or not holding or body.name not in (*holding, target.name):
        return [body]
    return [target, *holding.values()]


def _momenta(scene: Scene, bodies: Iterable[SceneBody]) -> tuple[Array, Array]:
    """Linear and angular momentum at the start, the latter about the common centre of mass (3,) each."""
    model, data = scene.model, scene.model.createData()
    pin.forwardKinematics(model, data, np.array(scene.q), np.array(scene.v))
    linear, angular, moment, mass = np.zeros(3), np.zeros(3), np.zeros(3), 0.0
    for joint in (joint for body in bodies for joint in body.subtree):
        inertia, place = model.inertias[joint], data.oMi[joint]
        momentum = place.act(inertia * data.v[joint])
        linear, angular = linear + momentum.linear, angular + momentum.angular
        moment, mass = moment + inertia.mass * place.act(inertia.lever), mass + inertia.mass
    return linear, angular - np.cross(moment / mass, linear)


def check_reach(problem: Problem, plan: Planning, tips: dict[str, SceneTip]) -> None:
    """Refuse a goal farther from a robot's centre of mass than its tip can ever be.

    The centre of mass of a floating robot that nothing drives moves uniformly, and its base is never far from
    it, so that the bound needs no solver.

    Raises
    ------
    ScenarioError
        With both distances.
    """
    if plan.limits.base_force or problem.stage.grips or problem.begin is not None:
        return
    scene = problem.stage.scene
    least, greatest, _ = problem.duration
    data = scene.model.createData()
    qs = drift(problem, Lobatto.of_order(2), INSTANTS, greatest)[0][int(INSTANTS * least / greatest) :]
    for name, goal in plan.goals.items():
        if not isinstance(goal, TipGoal):
            continue
        tip, nearest, stage = tips[goal.tip], np.inf, problem.stage
        allowed = _greatest_distance(problem, tip)
        place = ca.Function("place", [stage.q], [ca.densify(goal.place(Seen(stage, f"plan.goals.{name}")))])
        for q in qs:
            pin.framesForwardKinematics(scene.model, data, q)
            away = np.array(place(q)).ravel() - _centre(problem, tip, data, q)
            nearest = min(nearest, float(np.linalg.norm(away)))
        if nearest > allowed * (1 + 1e-6):
            raise ScenarioError(
                f"out of reach: at its nearest the goal is {nearest:.4g} m from {tip.body.name}'s centre of "
                f"mass, and {tip.label} is never more than {allowed:.4g} m from it",
                source=scene.source,
                where=f"plan.goals.{name}",
            )


def _greatest_distance(problem: Problem, tip: SceneTip) -> float:
    """Bound of the distance of a tip from what does not move of its robot [m]."""
    scene = problem.stage.scene
    length = reach(scene, tip)
    if not tip.body.root_joint:
        return length
    masses = {joint: float(scene.model.inertias[joint].mass) for joint in tip.body.subtree}
    whole, behind = sum(masses.values()), 0.0
    for joint in tip.body.joints:  # the farthest that its body can be from the base's origin
        distance = _length(problem, tip, joint) + float(np.linalg.norm(scene.model.inertias[joint].lever))
        behind += masses[joint] * distance
    behind += masses[tip.body.root_joint] * float(
        np.linalg.norm(scene.model.inertias[tip.body.root_joint].lever)
    )
    return length + behind / whole


def _length(problem: Problem, tip: SceneTip, joint: int) -> float:
    """Greatest distance of a joint's origin from the base's [m]."""
    scene, found = problem.stage.scene, 0.0
    while joint in tip.body.joints:
        found += float(np.linalg.norm(scene.model.jointPlacements[joint].translation))
        urdf = urdf_joint(scene, tip.body, joint)
        if urdf.kind == "prismatic":
            found += max(abs(urdf.lower), abs(urdf.upper))
        joint = scene.model.parents[joint]
    return found


def _centre(problem: Problem, tip: SceneTip, data: Any, q: Array) -> Array:
    """Centre of mass of a floating robot, or origin of a fixed one's root link [m]."""
    scene = problem.stage.scene
    if not tip.body.root_joint:
        return np.asarray(data.oMf[tip.body.root_frame].translation)
    pin.centerOfMass(scene.model, data, q)
    root = tip.body.root_joint
    return np.asarray(data.oMi[root].act(data.com[root]))
