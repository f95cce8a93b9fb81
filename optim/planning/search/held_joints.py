"""Approaches with an arm: a plan in which the joints keep their posture is the guess of one that moves them.

With its joints held, a base with an arm is one rigid body, and the plan has the unknowns of a base alone. Its
tip meets the goal in the posture of the start. That motion meets every constraint of the plan with the arm,
apart from the error of the mesh.
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np

from optim.planning.formulation.formulate import formulate_phases, plan_section
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.transcription.approach_guess import approached
from optim.planning.transcription.motion import Motion
from spacerobot.common.arrays import Array
from spacerobot.scene import Scene, build_scene


@functools.lru_cache(maxsize=4)
def solver_with_joints_held(solver: PlanSolver) -> PlanSolver | None:
    """Solver of the plan with all joints locked in the posture of the start.

    Args:
        solver: Solver of the plan with moving joints.

    Returns:
        PlanSolver or None: None where no base with an arm flies to the target, or the plan has several
            phases, a free start, or goals of joints.
    """
    problem = solver.problem
    bodies = [body for body in problem.stage.scene.robots if body.driven_joints]
    goals = solver.plan.goals.values()
    if len(solver.phases) > 1 or problem.begin is not None or not all(goal.mating for goal in goals):
        return None
    if not bodies or not all(approached(problem, body) for body in bodies):
        return None
    return PlanSolver.of(scene_with_joints_held(solver.scene), solver.backend, solver.notify)


def scene_with_joints_held(scene: Scene) -> Scene:
    """Scene with all driven joints locked where they are, and without costs of their motion.

    Args:
        scene: Scene with a ``plan`` section of one phase.
    """
    model, changes = scene.model, list[tuple[str, Any]]()
    for body in scene.robots:
        kinds = {joint.name: joint.kind for joint in body.description.joints}
        for joint in body.driven_joints:
            name, at = body.joint_name(model, joint), model.joints[joint].idx_q
            if model.joints[joint].nq == 2:
                position = float(np.arctan2(scene.q[at + 1], scene.q[at]))
            else:
                position = float(scene.q[at])
            is_length = kinds[name] == "prismatic"
            where = {"offset": position} if is_length else {"angle_deg": float(np.degrees(position))}
            changes.append((f"{body.path}.joints.{name}", {"locked": True} | where))
    # links of one robot no longer move relative to each other
    pads, zones = scene.scenario.pads, plan_section(scene).keep_out
    others = dict[str, Any]()
    for name, zone in zones.items():
        sides = () if zone.separated is None else zone.separated.between
        labels = [pads[side].link if side in pads else side for side in sides]
        if len({label.partition("/")[0] for label in labels}) > 1:
            others[name] = zone.model_dump(mode="json")
    changes.append(("plan.keep_out", others))
    held_scene = build_scene(scene.scenario, changes, source=scene.source)
    (phase,) = formulate_phases(held_scene)
    cost_names = {"time", *phase.problem.terms, *phase.problem.ends}
    changes += [
        (f"plan.costs.{name}", {"kind": cost.kind, "weight": 0.0})
        for name, cost in plan_section(scene).costs.items()
        if name not in cost_names
    ]
    return build_scene(scene.scenario, changes, source=scene.source)


def motion_with_joints(problem: PlanningProblem, held: Motion) -> Motion:
    """Motion of a scene with joints from that with joints held; their torques are those that hold them.

    Args:
        problem: The problem with joints.
        held: The motion without them.
    """
    stage, model = problem.stage, problem.stage.scene.model
    count, fewer = len(held.z), held.problem.stage.scene.model
    q = np.tile(problem.fixed[: model.nq], (count, 1))
    v, a = np.zeros((count, model.nv)), np.zeros((count, model.nv))
    for joint in range(1, fewer.njoints):
        of_model = model.joints[model.getJointId(fewer.names[joint])]
        of_fewer = fewer.joints[joint]
        columns = slice(of_fewer.idx_v, of_fewer.idx_v + of_fewer.nv)
        q[:, of_model.idx_q : of_model.idx_q + of_model.nq] = held.q[
            :, of_fewer.idx_q : of_fewer.idx_q + of_fewer.nq
        ]
        for values, held_values in ((v, held.v), (a, held.a)):
            values[:, of_model.idx_v : of_model.idx_v + of_model.nv] = held_values[:, columns]
    rest = np.zeros((count, stage.u.numel() + stage.w.numel() + stage.s.numel()))
    z = np.hstack([q, v, a, rest])
    drives = slice(model.nq + 2 * model.nv, model.nq + 2 * model.nv + stage.u.numel())
    z[:, drives] = balancing_drives(problem, z)
    return Motion(problem, held.lobatto, held.mesh, held.duration_s, z).split_forces()


def balancing_drives(problem: PlanningProblem, z: Array) -> Array:
    """Drives (n, nu) [N m or N] that balance the equations of motion at instants (n, nz) with drives of zero.

    Args:
        problem, z: The problem, and the instants.
    """
    stage = problem.stage
    arguments = ca.vertcat(stage.z, stage.inertia)
    left = ca.Function("left", [arguments], [ca.densify(stage.balance[list(stage.driven.columns)])])
    return np.array(left(problem.arguments(z)).full()).T
