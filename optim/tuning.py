"""Tuning by one call."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from optim.methods.by_name import Effort, Outcome, effort_of, run_method
from optim.methods.evolutionary import METHODS as EVOLUTIONARY
from optim.problem.blackbox import ResultObjective, ResultProblem
from optim.problem.objectives import UserObjective
from optim.problem.scenes import tuning_of
from optim.problem.tuning_problem import TuningProblem, build_problem
from optim.search.search import Progress
from optim.workers import Workers
from spacerobot.errors import ScenarioError, near_names
from spacerobot.scene import Scene, build_scene

NewVariables = Mapping[str, tuple[str, float, float]]


@dataclass(frozen=True)
class Tuned:
    """What tuning found.

    Attributes
    ----------
    gains
        Best values by variable, in the scenario's units.
    objective
        There.
    status, message
        Of the best run.
    scene
        The scene with these gains, ready for :func:`spacerobot.simulation.simulate`.
    outcome
        Every run.
    """

    gains: Mapping[str, float]
    objective: float
    status: str
    message: str
    scene: Scene
    outcome: Outcome


def tune(
    scene: Scene,
    method: str = "nlp",
    *,
    variables: NewVariables | Sequence[str] | None = None,
    variant: str | None = None,
    objective: UserObjective | None = None,
    score: ResultObjective | None = None,
    effort: Effort | None = None,
    folder: Path | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Tuned:
    """Tune a scene.

    Parameters
    ----------
    scene
        What to tune. Objective, constraints and variables are its tuning section's where not given here.
    method
        ``manual``, ``ga``, ``de``, ``pso``, ``cmaes``, ``sobol``, ``random``, ``nlp``, or ``nlp_ga``: the NLP
        from the GA's best.
    variables
        Names of the section's variables; or new ones: (dotted path, lower, upper) by name.
    variant
        Which of the section's variants.
    objective
        One's own: a function of the closed loop's signals that gives a scalar measure,
        ``lambda s: integral(ca.sumsqr(s["tip_error"]))``. Its gradients are exact.
    score
        One's own, any Python function of a result; for evolutionary methods only.
    effort
        How much may be done; the section's if None.
    folder
        Where journals are kept: a killed call, made again, goes on where it was and ends the same.
    workers
        Who rolls out: threads of this process if None, or from :func:`optim.workers.dask.open_workers`. The
        answer does not depend on it. A ``score`` is computed by this process.
    progress
        Told now and then.

    Raises
    ------
    ScenarioError
        If the problem does not fit the scene.
    SpaceRobotError
        If there is no such method, or it cannot solve this problem.
    """
    scene, chosen = _with_variables(scene, variables, variant)
    effort = effort or effort_of(tuning_of(scene))
    problem = build_problem(scene, chosen=chosen, variant=variant, objective=objective, workers=workers)
    run = partial(run_method, effort=effort, workers=problem.workers, folder=folder, progress=progress)
    if score is None:
        return _tuned(problem, _from_the_ga(problem, run) if method == "nlp_ga" else run(problem, method))
    if method not in EVOLUTIONARY:
        raise ScenarioError(f"a function of a result has no gradients; methods: {', '.join(EVOLUTIONARY)}")
    return _tuned(problem, run(ResultProblem(problem, score), method))


def _from_the_ga(problem: TuningProblem, run: Callable[..., Outcome]) -> Outcome:
    """The GA, and the NLP from its best."""
    ga = run(problem, "ga")
    if ga.interrupted:
        return ga
    outcome = run(problem, "nlp_ga", first=np.array(ga.best.u))
    return dataclasses.replace(outcome, runs=(*ga.runs, *outcome.runs))


def _tuned(problem: TuningProblem, outcome: Outcome) -> Tuned:
    best, variables = outcome.best, problem.variables
    values = variables.values(best.u)
    scene = build_scene(problem.scene.scenario, variables.as_changes(values), source=problem.scene.source)
    return Tuned(variables.as_mapping(values), best.objective, best.status, best.message, scene, outcome)


def _with_variables(
    scene: Scene, variables: NewVariables | Sequence[str] | None, variant: str | None
) -> tuple[Scene, Sequence[str] | None]:
    """The scene with new variables in its tuning section, and the names of those chosen."""
    section = scene.scenario.tuning
    if variant is not None:
        _known(variant, section.variants if section is not None else {}, "variant", scene)
    if not isinstance(variables, Mapping):
        for name in variables or ():
            _known(name, tuning_of(scene).variables, "variable", scene)
        return scene, variables
    for name, given in variables.items():
        if not (isinstance(given, tuple | list) and len(given) == 3 and isinstance(given[0], str)):
            message = f"found {given!r}, wanted: (dotted path, lower, upper)"
            raise ScenarioError(message, where=f"variables.{name}")
    made = {name: {"paths": [p], "lower": a, "upper": b} for name, (p, a, b) in variables.items()}
    changes: dict[str, object] = {"tuning.sets": {}, "tuning.variables": made}
    if section is None:
        changes = {"tuning": {"variables": made}}
    return build_scene(scene.scenario, changes, source=scene.source), list(made)


def _known(name: str, known: Iterable[str], what: str, scene: Scene) -> None:
    if name not in known:
        raise ScenarioError(f"no {what} {name!r}; {near_names(name, known)}", source=scene.source)
