"""Tuning by one call."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from optim.methods.evolutionary import METHODS as EVOLUTIONARY
from optim.methods.run_method import Effort, MethodOutcome, effort_of, run_method
from optim.problem.blackbox import ResultProblem
from optim.problem.scene_recipe import tuning_of
from optim.problem.tuning_problem import TuningProblem, build_problem
from optim.search.search import Progress
from optim.search.session import SearchSession
from spacerobot.errors import ScenarioError
from spacerobot.files import StrPath
from spacerobot.scene import Scene, build_scene

HALVINGS = 6
"""Most halvings of a step at which derivatives are inaccurate at the best point."""


@dataclass(frozen=True)
class TuningResult:
    """Result of tuning.

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
    outcome: MethodOutcome

    def __repr__(self) -> str:
        """Objective and how the best run ended, in one line."""
        gains = ", ".join(f"{name} {value:.4g}" for name, value in self.gains.items())
        return f"<Tuned {self.scene.scenario.name}: {self.status}, objective {self.objective:.6g}; {gains}>"


def tune(
    problem: Scene | TuningProblem | ResultProblem,
    method: str = "nlp",
    *,
    effort: Effort | None = None,
    folder: StrPath | None = None,
    progress: Progress | None = None,
) -> TuningResult:
    """Tune a problem.

    Parameters
    ----------
    problem
        From :func:`optim.build_problem`; or a scene, for what its tuning section asks; or an
        :class:`optim.ResultProblem`, whose objective is any Python function of a result, for evolutionary
        methods only.
    method
        ``manual``, ``ga``, ``de``, ``pso``, ``cmaes``, ``sobol``, ``random``, ``nlp``, or ``nlp_ga``: the NLP
        from the GA's best.
    effort
        How much may be done; the tuning section's if None.
    folder
        Where journals are kept: a killed call, made again, goes on where it was and ends the same.
    progress
        Told now and then.

    Raises
    ------
    ScenarioError
        If the problem does not fit the scene, or a function of a result is to be tuned by gradients.
    SpaceRobotError
        If there is no such method, or it cannot solve this problem.
    """
    stated = build_problem(problem) if isinstance(problem, Scene) else problem
    nominal = stated.problem if isinstance(stated, ResultProblem) else stated
    if stated is not nominal and method not in EVOLUTIONARY:
        raise ScenarioError(f"a function of a result has no gradients; methods: {', '.join(EVOLUTIONARY)}")
    effort = effort or effort_of(tuning_of(nominal.scene))
    run = partial(run_method, stated, effort=effort, session=SearchSession(folder, nominal.workers, progress))
    outcome = _from_the_ga(run) if method == "nlp_ga" else run(method)
    if method in ("nlp", "nlp_ga"):
        nominal, outcome = _refined(nominal, outcome, effort, progress)
    return _tuned(nominal, outcome)


def _refined(
    problem: TuningProblem, outcome: MethodOutcome, effort: Effort, progress: Progress | None
) -> tuple[TuningProblem, MethodOutcome]:
    """Descend again from the best point with half the step, until derivatives are accurate there.

    What was found with a longer step is not compared with it: its objective is not that of the same motion.
    """
    for _ in range(HALVINGS):
        best = outcome.best
        if outcome.interrupted or not np.isfinite(best.objective):
            break
        try:
            doubt = problem.step_doubt(np.array(best.u))
        except KeyboardInterrupt:
            stopped = dataclasses.replace(best, status="interrupted")
            return problem, dataclasses.replace(outcome, runs=(stopped,))
        if not doubt:
            break
        problem = problem.refined
        session = SearchSession(None, problem.workers, progress)
        (found,) = run_method(problem, "nlp_ga", effort, first=np.array(best.u), session=session).runs
        told = f"{found.message}; step refined to {problem.rollout.grid.step_s:.3g} s: {doubt}"
        found = dataclasses.replace(found, method=best.method, cost=best.cost + found.cost, message=told)
        outcome = dataclasses.replace(outcome, runs=(found,))
    return problem, outcome


def _from_the_ga(run: Callable[..., MethodOutcome]) -> MethodOutcome:
    """The GA, and the NLP from its best."""
    ga = run("ga")
    if ga.interrupted:
        return ga
    outcome = run("nlp_ga", first=np.array(ga.best.u))
    return dataclasses.replace(outcome, runs=(*ga.runs, *outcome.runs))


def _tuned(problem: TuningProblem, outcome: MethodOutcome) -> TuningResult:
    best, variables = outcome.best, problem.variables
    values = variables.values(best.u)
    scene = build_scene(problem.scene.scenario, variables.as_changes(values), source=problem.scene.source)
    return TuningResult(
        variables.as_mapping(values), best.objective, best.status, best.message, scene, outcome
    )
