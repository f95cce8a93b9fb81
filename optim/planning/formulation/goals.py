"""Goals as rows that vanish at the last instant."""

from __future__ import annotations

import dataclasses

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.elements.goal import Goal
from spacerobot.elements.plan_instant import BoundedRow


def goal_rows(stage: Stage, name: str, goal: Goal) -> list[BoundedRow]:
    """Rows of one goal.

    Raises
    ------
    ScenarioError
        If it names what there is not.
    """
    scene = stage.scene
    rows = list(goal.rows(InstantView(stage, f"plan.goals.{name}")))
    if goal.rests:
        body = next(body for body in scene.bodies if body.name == goal.body)
        tolerance = goal.rate_within
        rows += [
            BoundedRow(
                f"rate of {scene.model.names[j]}",
                "rad/s or m/s",
                stage.v[scene.model.idx_vs[j]],
                -tolerance,
                tolerance,
            )
            for j in body.driven_joints
        ]
    return [dataclasses.replace(row, name=f"{name}: {row.name}") for row in rows]
