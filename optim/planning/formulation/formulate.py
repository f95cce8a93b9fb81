"""Formulation of a scene's plan section as planning problems, one for each phase."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from optim.planning.formulation.costs import cost_terms, magnitudes, split_rows
from optim.planning.formulation.goals import goal_rows
from optim.planning.formulation.grasps import closed_grasps
from optim.planning.formulation.initial_conditions import initial_conditions
from optim.planning.formulation.path_constraints import (
    avoidance_rows,
    driven_coordinates,
    instant_limits,
    path_rows,
)
from optim.planning.formulation.stage import PlanningProblem, Stage
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.grasps.grasp import Grasp
from spacerobot.scenario.document import MISSING_SECTIONS
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene, build_scene
from spacerobot.scene.configure import close_velocity
from spacerobot.scene.grasp_closing import is_rigid
from spacerobot.scene.scene import SceneGrasp


def plan_section(scene: Scene) -> PlanSection:
    """The plan section of a scene.

    Raises:
        ScenarioError: If there is none.
    """
    if scene.scenario.plan is None:
        raise scene.error(MISSING_SECTIONS["plan"], "plan")
    return scene.scenario.plan


def scene_with_plan_model(scene: Scene) -> Scene:
    """Scene of the planning model: the plant with the changes of `plan.model`.

    Raises:
        ScenarioError: If a change names an unknown path, or changes the moving joints or the initial state.
    """
    changes = plan_section(scene).model
    if not changes:
        return scene
    for path in changes:
        if path.split(".")[0] not in ("robots", "target", "grasps", "gravity"):
            raise scene.error(
                f"found {path!r}, allowed: paths in robots, target, grasps and gravity", "plan.model"
            )
    try:
        plan_scene = build_scene(scene.scenario, changes, source=scene.source)
    except ScenarioError as fault:
        message = f"{str(fault.where or '').removeprefix('--set ')}: {fault.message}"
        raise scene.error(message, "plan.model") from None
    same = list(plan_scene.model.names) == list(scene.model.names)
    if not (same and np.array_equal(plan_scene.q, scene.q) and np.array_equal(plan_scene.v, scene.v)):
        raise scene.error(
            "changes where or with what the motion begins; allowed: masses, inertias and other numbers that "
            "leave configuration and velocity at the start as they are",
            "plan.model",
        )
    return plan_scene


@dataclass(frozen=True, eq=False)
class PhaseProblem:
    """Planning problem of one phase.

    Attributes:
        name: Name of the scenario's phase; empty where the plan names no phases.
        plan: Plan section of the phase.
        problem: Planning problem of the phase.
        impact: Whether rigid grasps close at its beginning, so that velocities jump by an impulse.
    """

    name: str
    plan: PlanSection
    problem: PlanningProblem
    impact: bool = False


def formulate(scene: Scene) -> PlanningProblem:
    """Planning problem of a scene; of its first phase if there are several.

    Raises:
        ScenarioError: If the section names something that the scene lacks.
    """
    return formulate_phases(scene)[0].problem


def formulate_phases(scene: Scene) -> tuple[PhaseProblem, ...]:
    """Planning problems of all phases, in order of time.

    Raises:
        ScenarioError: If the section names something that the scene lacks.
    """
    section, scene = plan_section(scene), scene_with_plan_model(scene)
    if section.choices:
        raise scene.error(
            f"{next(iter(section.choices))!r} is chosen where one plan is made; decide here, and give `{{}}`",
            "plan.choices",
        )
    problems, before = list[PhaseProblem](), tuple[SceneGrasp, ...]()
    for (name, plan), closed in zip(
        section.by_phase.items(), closed_grasps_by_phase(scene, section), strict=True
    ):
        impact = bool(problems) and any(is_rigid(grasp) and grasp not in before for grasp in closed)
        with located_in_phase(section, name):
            stage = Stage.of(scene, driven_coordinates(scene, plan.limits), closed)
            forces = magnitudes(stage, plan)
            parts = ca.SX.sym("s", 2 * sum(each.numel() for each in forces.values()))
            stage = dataclasses.replace(stage, s=parts)
            lower, upper = instant_limits(stage, plan.limits)
            goals = tuple(goal_rows(stage, plan.goals))
            terms, ends = cost_terms(stage, plan, forces)
            span, target = plan.duration, scene.target
            # of the target as the model has them, where the stage has symbols of them
            inertia = np.empty(0)
            if target is not None and stage.inertia.numel():
                inertia = np.array(scene.model.inertias[target.root_joint].toDynamicParameters())
            fixed = np.concatenate(
                [scene.q, close_velocity(scene) if stage.grips and not problems else scene.v]
            )
            begin, beginning = initial_conditions(stage, plan, fixed, (lower, upper))
            if problems:  # one that does not begin the plan begins where the one before it ends
                begin = (np.full(fixed.size, -np.inf), np.full(fixed.size, np.inf))
            problem = PlanningProblem(
                stage=stage,
                path=(
                    *path_rows(stage, plan),
                    *split_rows(stage, forces),
                    *beginning,
                    *avoidance_rows(stage, plan),
                ),
                goal=goals,
                terms=terms,
                ends=ends,
                weights={"time": plan.costs["time"].weight if "time" in plan.costs else 0.0}
                | {name: plan.costs[name].weight for name in (*terms, *ends)},
                lower=lower,
                upper=upper,
                duration=(span.lower, span.upper, span.guess or (span.lower + span.upper) / 2),
                fixed=fixed,
                tolerance=plan.tolerance,
                open_loop=plan.open_loop,
                begin=begin,
                magnitudes=forces,
                inertia=inertia,
            )
            problems.append(PhaseProblem(name, plan, problem, impact))
        before = closed
    return tuple(problems)


def check_weights(section: PlanSection, phases: Sequence[PhaseProblem]) -> None:
    """Refuse a weight of a term that exists in no phase.

    Args:
        section, phases: The plan section, and the problems of its phases.

    Raises:
        ScenarioError: If there is such a weight; the message names the term.
    """
    term_names = {name for phase in phases for name in (*phase.problem.terms, *phase.problem.ends)}
    for phase in phases:
        for name, cost in phase.plan.costs.items():
            if cost.weight and name != "time" and name not in term_names:
                with located_in_phase(section, phase.name):
                    raise phase.problem.stage.scene.error(
                        f"found a weight of {cost.weight:g}, but {cost.weighs.absent}; or leave the "
                        "weight out",
                        f"plan.costs.{name}",
                    )


@contextlib.contextmanager
def located_in_phase(section: PlanSection, name: str) -> Iterator[None]:
    """Context that locates errors of the plan section in its phase, if the phase sets the key at fault.

    Raises:
        ScenarioError: The error itself, located in the phase where it belongs to one.
    """
    try:
        yield
    except ScenarioError as fault:
        keys, value = str(fault.where or "").split("."), section.phases.get(name)
        for key in keys[1:3]:
            value = value.get(key) if isinstance(value, dict) else None
        if keys[0] != "plan" or not value:
            raise
        where = ".".join(["plan", "phases", name, *keys[1:]])
        raise ScenarioError(fault.message, source=fault.source, where=where) from None


def closed_grasps_by_phase(scene: Scene, section: PlanSection) -> Iterator[tuple[SceneGrasp, ...]]:
    """Grasps that hold in each phase of a plan: closed at the start or captured before it, and not released.

    Raises:
        ScenarioError: If a phase ends with a grasp captured whose tip no goal brings to its mating frame, or
            with strained springs.
    """
    closed, open_ = {grasp.name: grasp for grasp in closed_grasps(scene)}, {g.name: g for g in scene.grasps}
    for name, plan in section.by_phase.items():
        phase = scene.scenario.phases.get(name) if name else None
        for let_go in phase.releases if phase is not None else ():
            closed.pop(let_go, None)
        yield tuple(closed.values())
        captured = (phase.until.captured or ()) if phase is not None and phase.until is not None else ()
        if name == [*section.by_phase][-1]:
            return  # what closes behind the plan, closes as the scenario says
        for grasp in (open_[label] for label in captured):
            # refuse a capture without a goal that brings the tip there, and a spring that the capture would
            # strain
            config, where = grasp.config, f"plan.phases.{name}.goals"
            mating = mated(config, plan.goals)
            if not mating:
                raise scene.error(
                    f"the phase ends with {grasp.name!r} captured, so a goal must bring {config.tip!r} to "
                    f"{config.frame!r}: give `{{tip: {config.tip}, frame: {config.frame}}}`",
                    where,
                )
            goal = plan.goals[mating[0]]
            if not goal.is_exact:
                raise scene.error(
                    f"found a tolerance of the pose, where {grasp.name!r} closes on the mating frame; "
                    "leave it out",
                    f"{where}.{mating[0]}",
                )
            if not is_rigid(grasp) and goal.end_distance:
                raise scene.error(
                    f"found a standoff, where {grasp.name!r} closes and its springs are at rest; "
                    "leave it out",
                    f"{where}.{mating[0]}.standoff",
                )
            closed[grasp.name] = grasp


def mated(grasp: Grasp, goals: Mapping[str, Goal]) -> list[str]:
    """Names of the goals that bring a grasp's tip to its mating frame."""
    return [name for name, goal in goals.items() if goal.mating == (grasp.tip, grasp.frame)]
