"""Tuning by one call."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np

from optim.json_files import write_design
from optim.methods.run_method import (
    MethodOutcome,
    refuse_periods,
    run_method,
    stored_number,
    without_gradients,
)
from optim.methods.settings import Effort, stated_effort
from optim.methods.tuning_method import TuningMethod
from optim.problem.blackbox import ResultProblem
from optim.problem.objectives import OBJECTIVE, reading
from optim.problem.scene_recipe import tuning_of
from optim.problem.tuning_problem import TuningProblem, build_problem
from optim.problem.variables import at_bound
from optim.search.search import NOT_APPLICABLE, Progress
from optim.search.session import SearchSession
from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath, readable
from spacerobot.common.registry import TUNING_METHODS
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.scene import Scene, build_scene, load_scene

FILE, SCENARIO = "tuning.json", "scenario.yaml"
"""Files of a tuning's folder."""

HALVINGS = 6
"""Most halvings of a step at which derivatives are inaccurate at the best point."""


@dataclass(frozen=True)
class TuningResult(Tabular):
    """Result of tuning.

    Attributes:
        gains: Best values by variable, in the scenario's units.
        objective: Objective there.
        status, message: Status and message of the best run.
        scene: The scene with these gains, ready for :func:`spacerobot.simulate`.
        outcome: Every run.
        margins: Stability margins there that the tuning section names: value and requirement, by kind, loop
            and instant.
        reading: Name of the objective, and factor and unit in which it reads well.
    """

    gains: Mapping[str, float]
    objective: float
    status: str
    message: str
    scene: Scene
    outcome: MethodOutcome
    margins: Mapping[str, str] = field(default_factory=dict)
    reading: tuple[str, float, str] = (OBJECTIVE, 1.0, "")

    def save(self, folder: StrPath) -> None:
        """Write ``tuning.json``, and ``scenario.yaml`` with the gains unless the folder has a result of it.

        Raises:
            ResultError: If the folder holds something else or cannot be written.
        """
        data = {
            "gains": dict(self.gains),
            "active_bounds": list(at_bound(list(self.gains), self.outcome.best.u)),
            "objective": self.objective,
            "status": self.status,
            "message": self.message,
            **self.outcome.to_data(),
            "reading": list(self.reading),
        } | ({"margins": dict(self.margins)} if self.margins else {})
        write_design(folder, FILE, data, self.scene)

    @classmethod
    def load(cls, folder: StrPath) -> TuningResult:
        """Read what :meth:`save` wrote; the history of the runs is not kept.

        Raises:
            ResultError: If it cannot be read.
        """
        folder = Path(folder)
        with readable("tuning", folder / FILE):
            data = json.loads((folder / FILE).read_text(encoding="utf-8"))
            numbers = data["gains"], stored_number(data["objective"]), data["status"], data["message"]
            outcome = MethodOutcome.of_data(data)
            name, factor, unit = data.get("reading", (OBJECTIVE, 1.0, ""))
        scene = load_scene(folder / SCENARIO, expand_xacro=False)
        return cls(*numbers, scene, outcome, data.get("margins", {}), (name, factor, unit))

    def __repr__(self) -> str:
        """Objective and how the best run ended, in one line."""
        gains = ", ".join(f"{name} {value:.4g}" for name, value in self.gains.items())
        name = self.scene.scenario.name
        return f"<TuningResult {name}: {self.status}, objective {self.objective:.6g}; {gains}>"

    def content(self) -> list[Content]:
        """Objective, gains, margins, and how each run ended."""
        name, factor, unit = self.reading
        bounds = at_bound(list(self.gains), self.outcome.best.u)
        rows = [
            (gain, f"{value:.6g}{f', {bounds[gain]}' if gain in bounds else ''}")
            for gain, value in self.gains.items()
        ]
        content: list[Content] = [
            f"{self.outcome.method}: {name} {factor * self.objective:.6g} {unit}".rstrip(),
            Table.of_pairs("gains", rows),
        ]
        if self.margins:
            content.append(Table.of_pairs("margins", self.margins.items()))
        content += self.outcome.sentences(factor)
        trials = self.outcome.trials() if TUNING_METHODS.find(self.outcome.method).shows_trials else None
        return content if trials is None else [*content, trials]


def tune(
    problem: Scene | StrPath | TuningProblem | ResultProblem,
    method: str = "nlp",
    *,
    effort: Effort | Mapping[str, int | None] | None = None,
    folder: StrPath | None = None,
    progress: Progress | None = None,
) -> TuningResult:
    """Tune a problem.

    Args:
        problem: Problem from :func:`optim.build_problem`; a scene with a tuning section, or the name or file
            of its scenario; or an :class:`optim.ResultProblem`, whose objective is any Python function of a
            result, for evolutionary methods only.
        method: ``manual``, ``ga``, ``de``, ``pso``, ``cmaes``, ``sobol``, ``random``, ``nlp``, ``nlp_ga``
            (the NLP from the GA's best), or one of a plugin.
        effort: Budget of the method; or ``budget``, ``runs``, ``starts``, ``seed``, ... by name, which
            replace those of the tuning section. None takes those of the section.
        folder: Folder of the journals, from which an interrupted call resumes with the same result.
        progress: Callback that receives the progress of each run.

    Raises:
        ScenarioError: If the problem does not fit the scene, or a function of a result is to be tuned by
            gradients.
        SpaceRobotError: If there is no such method, or it cannot solve this problem.
    """
    stated = build_problem(problem) if isinstance(problem, Scene | str | PathLike) else problem
    nominal = stated.nominal if isinstance(stated, ResultProblem) else stated
    chosen: TuningMethod = TUNING_METHODS.find(method)
    if stated is not nominal and (chosen.uses_gradients or not chosen.solves_any_problem):
        raise ScenarioError(f"a function of a result has no gradients; methods: {without_gradients()}")
    refuse_periods(nominal, method)
    effort = stated_effort(effort, tuning_of(nominal.scene))
    run = partial(run_method, stated, effort=effort, session=SearchSession(folder, nominal.workers, progress))
    if chosen.starts_from is None:
        outcome = run(method)
    else:
        outcome = run(chosen.starts_from)
        if not outcome.interrupted:
            after = run(method, first=np.array(outcome.best.u))
            outcome = dataclasses.replace(after, runs=(*outcome.runs, *after.runs))
    if chosen.uses_gradients:
        nominal, outcome = _refined(nominal, outcome, effort, progress)
    best, variables = outcome.best, nominal.variables
    if best.status == NOT_APPLICABLE:
        raise nominal.scene.error(f"the method {method} {best.message}", "tuning.variables")
    values = variables.values(best.u)
    scene = build_scene(nominal.scene.scenario, variables.as_changes(values), source=nominal.scene.source)
    terms, margins = nominal.terms.margins, dict[str, str]()
    if terms is not None:
        margin_values = terms.values(values)
        margins = {row.name: row.text(one.value) for row, one in zip(terms.rows, margin_values, strict=True)}
    is_own = stated is not nominal or nominal.recipe.objective is not None
    return TuningResult(
        variables.as_mapping(values),
        best.objective,
        best.status,
        best.message,
        scene,
        outcome,
        margins,
        (OBJECTIVE, 1.0, "") if is_own else reading(tuning_of(nominal.scene).objective),
    )


def _refined(
    problem: TuningProblem, outcome: MethodOutcome, effort: Effort, progress: Progress | None
) -> tuple[TuningProblem, MethodOutcome]:
    """Descend again from the best point with half the step, until derivatives are accurate there.

    Results with different steps are not compared, because their objectives belong to different motions.
    """
    for _ in range(HALVINGS):
        best = outcome.best
        if outcome.interrupted or not np.isfinite(best.objective):
            break
        try:
            gradient_warning = problem.step_warning(np.array(best.u))
        except KeyboardInterrupt:
            stopped = dataclasses.replace(best, status="interrupted")
            return problem, dataclasses.replace(outcome, runs=(stopped,))
        if not gradient_warning:
            break
        problem = problem.refined
        session = SearchSession(None, problem.workers, progress)
        (run,) = run_method(problem, "nlp_ga", effort, first=np.array(best.u), session=session).runs
        step = problem.rollout.grid.step_s
        gradient_warning = gradient_warning.removeprefix("inaccurate: step: ")
        message = f"{run.message}; tuned again with a step of {step:.3g} s, because {gradient_warning}"
        run = dataclasses.replace(run, method=best.method, cost=best.cost + run.cost, message=message)
        outcome = dataclasses.replace(outcome, runs=(run,))
    return problem, outcome
