"""Comparison of methods on one problem, with the same rollouts and the same measures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from optim.comparison.cost_unit import CostUnit, cost_unit_of
from optim.comparison.design_evaluator import DesignEvaluator
from optim.comparison.running_time import MethodRun, trial_of
from optim.methods.run_method import MethodOutcome, run_method
from optim.methods.settings import Effort
from optim.problem.problem import EvaluationCost, OptimisationProblem
from optim.problem.sensitivities import Sensitivity, sensitivity
from optim.problem.tuning_problem import TuningProblem
from optim.problem.variables import at_bound
from optim.search.session import SearchSession
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS


@dataclass(frozen=True)
class Assessment:
    """Results of one design on the nominal plant and on plants it was not tuned for.

    Attributes:
        design: Values by dotted path; empty for the scenario's own.
        nominal: Objective () and measures (n,).
        varied: Objective (N,) and measures (N, n) on the other plants.
    """

    design: dict[str, float]
    nominal: dict[str, Array]
    varied: dict[str, Array]


@dataclass(frozen=True)
class CompileTimes:
    """Time to compile the functions of rollouts and of their derivatives, or to load them from the cache.

    Attributes:
        rollout_s, gradient_s: Time up to the first rollout, and from then to the first derivatives [s].
    """

    rollout_s: float
    gradient_s: float


@dataclass(frozen=True)
class ProblemComparison:
    """Comparison of all methods on one problem.

    Attributes:
        name: Name of the problem.
        problem: Problem to be solved.
        nominal: Problem of the nominal plant; equal to ``problem`` if there is one plant.
        outcomes: Outcome of each method, by name.
        errors: Largest tip error of each run's best design in each direction, (runs, n), by method.
        start: Objective at the scenario's values.
        baseline, assessments: Assessment of the untuned design, and of each method's best design by method;
            empty without a design evaluator.
        sensitivity: Sensitivity of the objective to each variable, at the start and at the best point.
        cost_unit: Cost of each kind of evaluation in rollouts.
        readiness: Time to compile the functions of the rollouts.
    """

    name: str
    problem: OptimisationProblem
    nominal: TuningProblem
    outcomes: dict[str, MethodOutcome]
    errors: dict[str, Array]
    start: float
    baseline: Assessment | None
    assessments: dict[str, Assessment]
    sensitivity: Sensitivity | None
    cost_unit: CostUnit
    readiness: CompileTimes
    interrupted: bool = False

    @property
    def ranked(self) -> list[str]:
        """Names of the methods that are ranked."""
        return [name for name in self.outcomes if TUNING_METHODS.find(name).is_ranked]

    @property
    def best_known(self) -> float:
        """Best feasible objective over all ranked methods and runs; NaN if no run is feasible."""
        runs = [run for name in self.ranked for run in self.outcomes[name].runs if run.feasible]
        return min((run.objective for run in runs), default=float("nan"))

    def trials(self, method: str) -> list[MethodRun]:
        """Independent runs of a method.

        One that starts from another method's best is charged all runs of that method too.
        """
        outcome = self.outcomes[method]
        before = EvaluationCost()
        if TUNING_METHODS.find(method).starts_from is not None:
            before = sum((run.cost for run in _evolved(self.outcomes, method).runs), before)
        return [trial_of(run, self.cost_unit, before) for run in outcome.runs]

    def active(self, method: str) -> list[str]:
        """Variables of a method's best that are at (or beyond) a bound."""
        return list(at_bound(self.nominal.names, self.outcomes[method].best.u))


@dataclass(frozen=True)
class BenchmarkProblem:
    """A problem to compare methods on.

    Attributes:
        name: Name of the problem.
        problem: Problem to be solved.
        nominal: See :class:`ProblemComparison`.
        judge: Rolls out designs on other plants; they are not judged there if None.
    """

    name: str
    problem: OptimisationProblem
    nominal: TuningProblem
    judge: DesignEvaluator | None = None


def compare_on_problem(
    entry: BenchmarkProblem, methods: Sequence[str], effort: Effort, session: SearchSession
) -> ProblemComparison:
    """Run methods on one problem.

    Args:
        entry: The problem.
        methods: Methods, in order of their runs.
        effort: Budget of the methods.
        session: Journals, workers and callbacks.

    Returns:
        Problem: Comparison; after Ctrl-C, the results until then.
    """
    problem, nominal = entry.problem, entry.nominal
    effort = replace(effort, repeats=effort.runs)  # as many independent runs of every method
    begin = time.perf_counter()
    start = float(problem.evaluate(problem.start[None]).objective[0])
    rolled_out = time.perf_counter()
    if any(TUNING_METHODS.find(n).uses_gradients for n in methods):
        problem.linearise(problem.start)
    readiness = CompileTimes(rolled_out - begin, time.perf_counter() - rolled_out)
    cost_unit, effort = cost_unit_of(nominal), replace(effort, repeats=effort.runs)
    place = None if session.place is None else session.place / entry.name
    problem_session = replace(session, folder=place, workers=nominal.workers)
    outcomes: dict[str, MethodOutcome] = {}
    for method in methods:
        continues = TUNING_METHODS.find(method).starts_from is not None
        first = np.array(_evolved(outcomes, method).best.u) if continues else None
        outcomes[method] = run_method(problem, method, effort, first=first, session=problem_session)
        if outcomes[method].interrupted:
            break
    interrupted = any(outcome.interrupted for outcome in outcomes.values())
    leader = min(outcomes.values(), key=_rank)
    points = {"start": problem.start, leader.method: np.clip(leader.best.u, 0, 1)}
    judge, variables = entry.judge, nominal.variables
    assessments = dict[str, Assessment]()
    errors = dict[str, Array]()  # largest on each tip and axis of each run's best, (runs, n) [m]
    for name, outcome in outcomes.items():
        peaks = nominal.measure(np.array([run.u for run in outcome.runs]))["tip_error_peak"]
        half = peaks.shape[1] // 2
        errors[name] = np.maximum(peaks[:, :half], peaks[:, half:])
        if judge is not None:
            design = variables.as_changes(variables.values(outcome.best.u))
            assessments[name] = assess(judge, design)
    return ProblemComparison(
        entry.name,
        problem,
        nominal,
        outcomes,
        errors,
        start,
        None if judge is None else assess(judge, {}),
        assessments,
        None if interrupted or judge is None else sensitivity(nominal, points),
        cost_unit,
        readiness,
        interrupted,
    )


def assess(judge: DesignEvaluator, design: dict[str, float]) -> Assessment:
    """Evaluate a design, given by dotted paths, on the nominal plant and on others."""
    return Assessment(design, judge.nominal(design), judge.varied(design))


def _evolved(outcomes: dict[str, MethodOutcome], method: str) -> MethodOutcome:
    """Outcome whose best point is a method's start.

    It is that of ``starts_from``, or of another ranked method without gradients if that one did not run.

    Raises:
        SpaceRobotError: If no such method ran.
    """
    first = TUNING_METHODS.find(method).starts_from
    methods = TUNING_METHODS.entries()
    able = [name for name, each in methods.items() if each.is_ranked and not each.uses_gradients]
    candidates = [outcomes[name] for name in (first, *able) if name in outcomes]
    if not candidates:
        raise SpaceRobotError(f"{method} starts from the best of {first}: run it too")
    return candidates[0]


def _rank(outcome: MethodOutcome) -> tuple[bool, float]:
    value = outcome.best.objective
    return not outcome.best.feasible, value if np.isfinite(value) else np.inf
