"""Choices of a plan, such as mating frames: each candidate is planned, and the cheapest plan is returned."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from optim.planning.formulation.formulate import plan_section
from spacerobot.common.errors import NoPlanError, ScenarioError
from spacerobot.scene import Scene, build_scene

T = TypeVar("T")
Value = str | float


@dataclass(frozen=True)
class Candidate:
    """Outcome of one candidate.

    Attributes:
        chosen: Value of each choice, by name.
        cost: Cost of its plan; None without a plan.
        failure: Reason for the lack of a plan.
    """

    chosen: dict[str, Value]
    cost: float | None = None
    failure: str = ""


def best_candidate(
    scene: Scene, plan: Callable[[Scene, str], tuple[float, T]]
) -> tuple[T, tuple[Candidate, ...]]:
    """Cheapest plan among all candidates, and the outcome of each.

    Args:
        scene: The scene.
        plan: Function that plans for a scene and returns cost and plan; its second argument lists the
            candidate's choices as text, which is empty without choices.

    Raises:
        ScenarioError: If there are neither choices nor a plan, or a choice has an unknown path or an invalid
            value.
        NoPlanError: If no candidate leads to a plan.
    """
    best: tuple[float, T] | None = None
    candidates, choices = list[Candidate](), plan_section(scene).choices
    # combinations of choices, each with its scene; the scene itself if its plan has no choices
    scenes: list[tuple[dict[str, Value], Scene]] = [] if choices else [({}, scene)]
    for values in itertools.product(*(choice.among for choice in choices.values())) if choices else ():
        changes = [
            (path, value)
            for choice, value in zip(choices.values(), values, strict=True)
            for path in choice.paths
        ]
        built = build_scene(scene.scenario, [("plan.choices", {}), *changes], source=scene.source)
        scenes.append((dict(zip(choices, values, strict=True)), built))
    for chosen, each in scenes:
        words = ", ".join(f"{name} {value}" for name, value in chosen.items())
        try:
            cost, planned = plan(each, words)
        except (NoPlanError, ScenarioError) as fault:
            if not chosen:
                raise
            candidates.append(Candidate(chosen, failure=fault.message))
            continue
        candidates.append(Candidate(chosen, cost))
        if best is None or cost < best[0]:
            best = cost, planned
    if best is None:
        failures = "; ".join(
            f"{', '.join(map(str, one.chosen.values()))}: {one.failure}" for one in candidates
        )
        raise NoPlanError(
            f"no candidate leads to a plan: {failures}", source=scene.source, where="plan.choices"
        )
    return best[1], tuple(candidates) if scenes[0][0] else ()
