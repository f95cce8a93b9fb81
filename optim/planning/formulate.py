"""From a scene's plan section to a planning problem."""

from __future__ import annotations

import numpy as np

from optim.planning.costs import cost_terms
from optim.planning.goals import goal_rows
from optim.planning.limits import instant_limits, path_rows, what_drives
from optim.planning.stage import Problem, Stage
from optim.planning.start import beginnings
from spacerobot.errors import ScenarioError
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene
from spacerobot.scene.configure import close_velocity


def plan_of(scene: Scene) -> Planning:
    """The plan section of a scene.

    Raises
    ------
    ScenarioError
        If there is none.
    """
    if scene.scenario.plan is None:
        raise ScenarioError(
            "no such section: it says what to plan (docs/planning.md)", source=scene.source, where="plan"
        )
    return scene.scenario.plan


def formulate(scene: Scene) -> Problem:
    """Planning problem of a scene.

    Raises
    ------
    ScenarioError
        If the section asks for what there is not.
    """
    plan = plan_of(scene)
    if scene.scenario.environment:
        raise ScenarioError(
            f"found {next(iter(scene.scenario.environment))!r}; plans know gravity alone, and no environment",
            source=scene.source,
            where="environment",
        )
    stage = Stage.of(scene, what_drives(scene, plan.limits))
    lower, upper = instant_limits(stage, plan.limits)
    goals = [row for name, goal in plan.goals.items() for row in goal_rows(stage, name, goal)]
    terms = cost_terms(stage, plan.costs)
    span = plan.duration
    fixed = np.concatenate([scene.q, close_velocity(scene) if stage.grips else scene.v])
    begin, beginning = beginnings(stage, plan, fixed, (lower, upper))
    return Problem(
        stage=stage,
        path=(*path_rows(stage, plan), *beginning),
        goal=tuple(goals),
        terms=terms,
        weights={name: getattr(plan.costs, name) for name in (*terms, "time")},
        lower=lower,
        upper=upper,
        duration=(span.lower, span.upper, span.guess or (span.lower + span.upper) / 2),
        fixed=fixed,
        tolerance=plan.tolerance,
        begin=begin,
    )
