"""Checks before a solver runs: a start that violates its own limits, a goal beyond an arm's reach."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.rows import row_values
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.initial_guess import drift
from optim.planning.transcription.lobatto import Lobatto
from spacerobot.common.arrays import Array
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene
from spacerobot.scene.reference_checks import com_from_base, reach
from spacerobot.scene.scene import SceneBody, SceneTip

SLACK = 1e-9
"""Violation at the start that is attributed to rounding."""
MISSED = 1e-6
"""Distance from an unchangeable goal above which it is refused."""
INSTANTS = 100
"""Number of instants of a free duration at which a moving goal is evaluated."""


def check_start(problem: PlanningProblem) -> None:
    """Refuse a prescribed start that violates its own limits.

    Raises:
        ScenarioError: If it violates a limit; the message names the limit.
    """
    if problem.begin is not None:
        return
    scene, driven = problem.stage.scene, problem.stage.driven
    model = scene.model
    for joint in driven.joints:
        joint_model, name = model.joints[joint], str(model.names[joint])
        checked = [("rate", model.nq + joint_model.idx_v, "rad/s or m/s")]
        if joint_model.nq == 1:
            checked.append(("position", joint_model.idx_q, "rad or m"))
        for what, place, unit in checked:
            least, greatest = problem.lower[place], problem.upper[place]
            if not least - SLACK <= problem.fixed[place] <= greatest + SLACK:
                raise scene.error(
                    f"the start violates a limit: the {what} of {name} is {problem.fixed[place]:.4g}, "
                    f"allowed {least:.4g} to {greatest:.4g} {unit}; begin elsewhere or change the limit",
                    "plan",
                )
    stage = problem.stage
    later = ca.vertcat(stage.a, stage.u, stage.w, stage.s)
    rows = [row for row in problem.path if row.final_fraction == 1.0 and not ca.depends_on(row.value, later)]
    if not rows:
        return
    rest = np.zeros(problem.stage.z.numel() - len(problem.fixed))
    start_values = row_values(rows, problem.stage.z, np.concatenate([problem.fixed, rest])[:, None])[:, 0]
    for row, value in zip(rows, start_values, strict=True):
        if not row.lower - SLACK <= value <= row.upper + SLACK:
            over = max(row.lower - value, value - row.upper) * row.scale
            raise scene.error(
                f"the start violates a limit: {row.name} is passed by {over:.4g} {row.unit}; begin elsewhere "
                "or change the limit",
                "plan",
            )


def check_momentum(problem: PlanningProblem, plan: PlanSection) -> None:
    """Refuse goals of rest for bodies whose momentum nothing absorbs, and two such goals for one body.

    Actuators of bases absorb no more than their largest wrench does in the longest duration.

    Raises:
        ScenarioError: If there is such a goal; the message states the reason, such as the momentum.
    """
    scene, resting = problem.stage.scene, dict[str, str]()
    for name, goal in plan.goals.items():
        if goal.stops is None:
            continue
        where = f"plan.goals.{name}"
        body = next(body for body in scene.bodies if body.name == goal.stops)
        # a body, and the bodies that welds join with it
        target = scene.target
        holding = {
            grip.tip.body.name: grip.tip.body for grip in problem.stage.grips if grip.config.fixes_orientation
        }
        if target is None or not holding or body.name not in (*holding, target.name):
            group = [body]
        else:
            group = [target, *holding.values()]
        if body.name in resting:
            raise scene.error(
                f"{body.name} comes to rest by goal {resting[body.name]!r} already, by a weld; leave "
                "one of the two out",
                where,
            )
        if problem.stage.springs:
            continue  # they may take it
        names = {one.name for one in group}
        resting |= dict.fromkeys(names, name)
        if names == {"target"}:
            message = "moves on as it does, for nothing holds it"
            raise scene.error(f"{body.name} {message}", where)
        if any(not one.root_joint for one in group):
            continue  # the world takes it
        # bounds of the force [N], and of the torque about the centre of mass [N m], on the bases of bodies
        driven = problem.stage.driven
        bases = [body for body in group if body is not scene.target]
        force, torque = (sum(driven.strength(body.name, part) for body in bases) for part in "ft")
        # a base force also has a moment about the centre of mass; it is bounded for a single robot only
        lever = com_from_base(scene, bases[0]) if len(group) == 1 else np.inf
        able_of = force, torque + (lever * force if force else 0.0)
        momenta = zip(_momenta(scene, group), able_of, strict=True)
        for (momentum, able), unit, key in zip(
            momenta, ("N s", "N m s"), ("base_force", "base_torque"), strict=True
        ):
            size, most = float(np.linalg.norm(momentum)), able * problem.duration[1]
            if size <= max(SLACK, most * (1 + 1e-6)):
                continue
            message = f"for nothing takes its momentum of {size:.4g} {unit}; give `limits.{key}`"
            if able:
                message = (
                    f"for its momentum is {size:.4g} {unit}, of which {problem.duration[1]:g} s take no more "
                    f"than {most:.4g} {unit}; raise `limits.{key}`, or the duration"
                )
            raise scene.error(f"{body.name} cannot come to rest, {message}", where)


def check_joined(problem: PlanningProblem, plan: PlanSection) -> None:
    """Refuse a goal of rest relative to the target if the robot's conserved momenta do not allow it.

    A free-floating body keeps its momenta. A robot with joints at rest and its tip moving with the mating
    frame moves as one body with the target: its momenta are m v and, about its centre of mass, I w for some
    inertia I.

    Raises:
        ScenarioError: If there is such a goal; the message states the conserved speed or angular momentum.
    """
    scene, tips = problem.stage.scene, {tip.label: tip for tip in problem.stage.scene.tips}
    model, data = scene.model, scene.model.createData()
    if problem.stage.driven.drives_bases or problem.stage.grips or problem.begin is not None:
        return
    for name, goal in plan.goals.items():
        if goal.mating is None or goal.end_speed is None:
            continue
        tip = tips[goal.mating[0]]
        if not tip.body.root_joint:
            continue
        linear, angular = _momenta(scene, [tip.body])
        mass = sum(float(model.inertias[joint].mass) for joint in tip.body.subtree)
        velocity, near = linear / mass, _greatest_distance(problem, tip)
        # velocity and spin of the mating frame, world axes, at possible final times (n, 3) each [m/s, rad/s]
        frame, mate = model.getFrameId(f"target/{goal.mating[1]}", pin.FrameType.BODY), []
        for q, v in zip(*_free_motion(problem), strict=True):
            pin.forwardKinematics(model, data, q, v)
            motion = pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            mate.append((motion.linear, motion.angular))
        velocities, spins = (np.array(side) for side in zip(*mate, strict=True))
        turning, turned = np.linalg.norm(spins, axis=1), float(np.linalg.norm(angular))
        apart = np.linalg.norm(velocities - velocity, axis=1) - turning * near - goal.end_speed
        fault = ""
        if apart.min() > SLACK:
            speed = np.linalg.norm(velocity)
            fault = f"its centre of mass continues at {speed:.4g} m/s, another velocity than that"
        elif np.all((spins @ angular <= SLACK * turned) & (turning + turned > SLACK)):
            fault = f"its angular momentum stays {turned:.4g} N m s, so it cannot turn likewise"
        if fault:
            raise scene.error(
                f"{tip.body.name} cannot end at rest relative to the target: nothing acts on it from outside "
                f"and {fault}; leave `rest` out, or give `limits.base_force` and `base_torque`",
                f"plan.goals.{name}",
            )


def _free_motion(problem: PlanningProblem) -> tuple[Array, Array]:
    """Configurations (n, nq) and velocities (n, nv) of free drift at the possible final times."""
    least, greatest, _ = problem.duration
    q, v = drift(problem, Lobatto.of_order(2), INSTANTS, greatest)
    first = int(INSTANTS * least / greatest)
    return q[first:], v[first:]


def _momenta(scene: Scene, bodies: Iterable[SceneBody]) -> tuple[Array, Array]:
    """Linear momentum, and angular momentum about the common centre of mass, at the start (3,) each."""
    model, data = scene.model, scene.model.createData()
    pin.forwardKinematics(model, data, np.array(scene.q), np.array(scene.v))
    linear, angular, moment, mass = np.zeros(3), np.zeros(3), np.zeros(3), 0.0
    for joint in (joint for body in bodies for joint in body.subtree):
        inertia, place = model.inertias[joint], data.oMi[joint]
        momentum = place.act(inertia * data.v[joint])
        linear, angular = linear + momentum.linear, angular + momentum.angular
        moment, mass = moment + inertia.mass * place.act(inertia.lever), mass + inertia.mass
    return linear, angular - np.cross(moment / mass, linear)


def check_changeable(problem: PlanningProblem) -> None:
    """Refuse goals on coordinates that cannot be influenced and do not meet the goal by themselves.

    A coordinate is beyond influence if it is neither driven nor joined to a driven body.

    Raises:
        ScenarioError: If a goal is missed; the message states the smallest distance.
    """
    stage, scene = problem.stage, problem.stage.scene
    if problem.begin is not None or stage.grips or stage.springs or not problem.goal:
        return
    driven = {scene.model.names[joint].partition("/")[0] for joint in stage.driven.joints}
    driven |= {name.partition("/")[0] for name in stage.driven.names}
    free = [joint for body in scene.bodies if body.name not in driven for joint in body.subtree]
    fixed = np.ones(scene.model.nq, dtype=bool), np.ones(scene.model.nv, dtype=bool)
    for joint in free:
        joint_model = scene.model.joints[joint]
        fixed[0][joint_model.idx_q : joint_model.idx_q + joint_model.nq] = False
        fixed[1][joint_model.idx_v : joint_model.idx_v + joint_model.nv] = False
    moved = ca.vertcat(
        stage.q[np.flatnonzero(fixed[0]).tolist()],
        stage.v[np.flatnonzero(fixed[1]).tolist()],
        stage.a,
        stage.u,
    )
    rows = [row for row in problem.goal if not ca.depends_on(row.value, moved)]
    if not rows:
        return
    state = np.hstack(_free_motion(problem)).T
    values = ca.Function("goals", [ca.vertcat(stage.q, stage.v)], [ca.vertcat(*(row.value for row in rows))])
    for row, extremes in zip(rows, np.array(values(state)).reshape(len(rows), -1), strict=True):
        over = np.maximum(row.lower - extremes, extremes - row.upper)
        crossed = row.lower == row.upper and extremes.min() <= row.lower <= extremes.max()
        if not crossed and over.min() > MISSED:
            raise scene.error(
                f"{row.name}: nothing that is planned changes it, and it misses by at least "
                f"{over.min() * row.scale:.3g} {row.unit}; leave the goal out, or drive or hold its body",
                "plan.goals",
            )


def check_reach(problem: PlanningProblem, plan: PlanSection, tips: dict[str, SceneTip]) -> None:
    """Refuse a goal farther from a robot's centre of mass than its tip can ever be.

    The centre of mass of a free-floating robot moves uniformly, and the distance between base and centre of
    mass is bounded. The check therefore needs no solver.

    Raises:
        ScenarioError: If a goal cannot be reached; the message states both distances.
    """
    scene, driven = problem.stage.scene, problem.stage.driven
    pushed = any(driven.strength(body.name, "f") for body in scene.robots)
    if pushed or problem.stage.grips or problem.begin is not None:
        return
    data, (qs, _) = scene.model.createData(), _free_motion(problem)
    for name, goal in plan.goals.items():
        if goal.tip_label is None:
            continue
        tip, nearest, stage = tips[goal.tip_label], np.inf, problem.stage
        allowed = _greatest_distance(problem, tip)
        place = ca.Function(
            "place", [stage.q], [ca.densify(goal.place(InstantView(stage, f"plan.goals.{name}")))]
        )
        for q in qs:
            pin.framesForwardKinematics(scene.model, data, q)
            # centre of mass of a floating robot, or origin of a fixed one's root link
            centre, root = data.oMf[tip.body.root_frame].translation, tip.body.root_joint
            if root:
                pin.centerOfMass(scene.model, data, q)
                centre = data.oMi[root].act(data.com[root])
            nearest = min(nearest, float(np.linalg.norm(np.array(place(q)).ravel() - centre)))
        if nearest > allowed * (1 + 1e-6):
            raise scene.error(
                f"out of reach: at its nearest the goal is {nearest:.4g} m from {tip.body.name}'s centre of "
                f"mass, and {tip.label} is never more than {allowed:.4g} m from it",
                f"plan.goals.{name}",
            )


def _greatest_distance(problem: PlanningProblem, tip: SceneTip) -> float:
    """Upper bound of a tip's distance from the robot's centre of mass or fixed root [m]."""
    scene = problem.stage.scene
    length = reach(scene, tip.body, tip.frame)
    if not tip.body.root_joint:
        return length
    return length + com_from_base(scene, tip.body)
