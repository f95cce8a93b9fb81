"""All methods on the same problems, with the same rollouts, judged by the same measures."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from optim.evolutionary import METHODS as EVOLUTIONARY
from optim.linearise import linearise
from optim.methods import Effort, Outcome, effort_of, run_method
from optim.plants import Judge, build_judge
from optim.problem import TuningProblem, build_problem
from optim.protocol import Array
from optim.scenes import tuning_of
from optim.search import Progress
from optim.sensitivity import Sensitivity, sensitivity
from optim.workers import Threads, Workers
from spacerobot.errors import ScenarioError, near_names
from spacerobot.scene import Scene

NEAR_BOUND = 1e-3  # of the unit cube: nearer counts as active
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Verdict:
    """One design on the nominal plant and on plants it was not tuned for.

    Attributes
    ----------
    design
        Values by dotted path; empty for the scenario's own.
    nominal
        Objective () and measures (n,).
    varied
        Objective (N,) and measures (N, n) on the other plants.
    """

    design: dict[str, float]
    nominal: dict[str, Array]
    varied: dict[str, Array]


@dataclass(frozen=True)
class Contest:
    """All methods on one problem.

    Attributes
    ----------
    problem, reading, chosen
        The problem, and which reading and set of variables it is.
    outcomes
        What each method found, by name.
    errors
        Largest error of each run's best in each direction, (runs, n), by method.
    baseline, verdicts
        The untuned design, and each method's best, by method.
    sensitivity
        How much each variable matters at the start and at the best point found.
    rollout_s, gradient_cost
        Time of one core for a rollout in a batch, and how many of them a gradient costs; measured.
    """

    problem: TuningProblem
    reading: str | None
    chosen: str | None
    outcomes: dict[str, Outcome]
    errors: dict[str, Array]
    baseline: Verdict
    verdicts: dict[str, Verdict]
    sensitivity: Sensitivity | None
    rollout_s: float
    gradient_cost: float
    interrupted: bool = False

    @property
    def name(self) -> str:
        """Reading and set of variables."""
        return "-".join(part for part in (self.reading, self.chosen) if part) or "tuning"

    def active(self, method: str) -> list[str]:
        """Variables of a method's best that are at (or beyond) a bound."""
        u = self.outcomes[method].best.u
        return [
            n for n, x in zip(self.problem.names, u, strict=True) if x <= NEAR_BOUND or x >= 1 - NEAR_BOUND
        ]


@dataclass(frozen=True)
class Comparison:
    """Contests on all problems of a scenario.

    Attributes
    ----------
    scene
        The scene.
    contests
        One for each reading and set of variables.
    effort
        What the methods were allowed.
    wall_s
        Time it all took.
    """

    scene: Scene
    contests: tuple[Contest, ...]
    effort: Effort
    wall_s: float
    interrupted: bool = field(default=False)


def compare(
    scene: Scene,
    *,
    methods: Sequence[str] | None = None,
    readings: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    effort: Effort | None = None,
    folder: Path | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Comparison:
    """Run methods on the problems of a scene's tuning section.

    Parameters
    ----------
    scene
        The scene.
    methods, readings, sets
        Which; all that the section names if None.
    effort
        What the methods may do; the section's if None.
    folder
        Where journals are kept, so that a killed comparison goes on where it was.
    workers
        Who rolls out; threads of this process if None. The results do not depend on it, save times.
    progress, tell
        Told how a search is getting on, and what begins.

    Returns
    -------
    Comparison
        After Ctrl-C, what was found until then.

    Raises
    ------
    ScenarioError
        If there is no tuning section, or it does not have what was asked for.
    """
    tuning, begin = tuning_of(scene), time.perf_counter()
    effort, workers = effort or effort_of(tuning), workers or Threads()
    contests: list[Contest] = []
    say = tell or (lambda _: None)
    for reading in _chosen(readings, list(tuning.readings), scene, "readings"):
        say(f"{reading or 'tuning'}: building and compiling the rollout that judges")
        judge = build_judge(scene, reading=reading, threads=workers.threads)
        for chosen in _chosen(sets, list(tuning.sets), scene, "sets"):
            say(f"{reading or 'tuning'}, {chosen or 'all variables'}: building and compiling")
            variables = tuning.sets[chosen] if chosen is not None else None
            problem = build_problem(scene, chosen=variables, reading=reading, workers=workers)
            home = folder / "-".join(x for x in (reading or "", chosen or "") if x) if folder else None
            contest = _contest(
                problem, judge, reading, chosen, methods or tuning.methods, effort, home, progress
            )
            contests.append(contest)
            if contest.interrupted:
                return Comparison(scene, tuple(contests), effort, time.perf_counter() - begin, True)
    return Comparison(scene, tuple(contests), effort, time.perf_counter() - begin)


def _contest(
    problem: TuningProblem,
    judge: Judge,
    reading: str | None,
    chosen: str | None,
    methods: Sequence[str],
    effort: Effort,
    folder: Path | None,
    progress: Progress | None,
) -> Contest:
    rollout_s, gradient_cost = measure_costs(problem)
    outcomes: dict[str, Outcome] = {}
    first: Array | None = None
    for method in methods:
        if method == "nlp_ga":
            first = _best_evolutionary(outcomes)
        outcomes[method] = run_method(
            problem, method, effort, workers=problem.workers, first=first, folder=folder, progress=progress
        )
        if outcomes[method].interrupted:
            break
    errors = {name: _errors(problem, outcome) for name, outcome in outcomes.items()}
    verdicts = {name: verdict(judge, _design(problem, outcome.best.u)) for name, outcome in outcomes.items()}
    leader = min(outcomes.values(), key=_rank)
    interrupted = any(outcome.interrupted for outcome in outcomes.values())
    inside = np.clip(leader.best.u, 0, 1)
    return Contest(
        problem,
        reading,
        chosen,
        outcomes,
        errors,
        verdict(judge, {}),
        verdicts,
        None if interrupted else sensitivity(problem, {"start": problem.start, leader.method: inside}),
        rollout_s,
        gradient_cost,
        interrupted,
    )


def verdict(judge: Judge, design: dict[str, float]) -> Verdict:
    """Judge a design, given by dotted paths."""
    return Verdict(design, judge.nominal(design), judge.varied(design))


def measure_costs(problem: TuningProblem, rollouts: int = 32) -> tuple[float, float]:
    """Seconds of one core for a rollout in a batch, and how many rollouts a gradient costs: medians of three.

    Both are measured at the start point, on one thread, once everything is compiled.
    """
    u = np.tile(problem.start, (rollouts, 1))
    values = problem.variables.values(u)
    problem.rollout.batch(problem.names, values[:1], threads=1)
    linearise(problem, problem.start)

    def batch() -> None:
        problem.rollout.batch(problem.names, values, threads=1)

    def gradient() -> None:
        linearise(problem, problem.start)

    each = _median_seconds(batch) / rollouts
    return each, _median_seconds(gradient) / each


def _median_seconds(work: Callable[[], None]) -> float:
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def _best_evolutionary(outcomes: dict[str, Outcome]) -> Array | None:
    """The GA's best point; that of another evolutionary method if the GA did not run."""
    found = [outcomes[name] for name in EVOLUTIONARY if name in outcomes]
    return np.array(found[0].best.u) if found else None


def _design(problem: TuningProblem, u: Array) -> dict[str, float]:
    return problem.variables.as_changes(problem.variables.values(u))


def _rank(outcome: Outcome) -> tuple[bool, float]:
    value = outcome.best.objective
    return not outcome.best.feasible, value if np.isfinite(value) else np.inf


def _errors(problem: TuningProblem, outcome: Outcome) -> Array:
    """Largest absolute error on each tip and axis of each run's best, (runs, n) in m."""
    points = np.array([run.u for run in outcome.searches or outcome.runs])
    peaks = problem.measure(points)["tip_error_peak"]
    half = peaks.shape[1] // 2
    return np.maximum(peaks[:, :half], peaks[:, half:])


def _chosen(wanted: Sequence[str] | None, known: Sequence[str], scene: Scene, what: str) -> list[str | None]:
    for name in wanted or ():
        if name not in known:
            raise ScenarioError(
                f"no {name!r}; {near_names(name, known)}", source=scene.source, where=f"tuning.{what}"
            )
    return [*(wanted or known)] or [None]
