"""Methods by their names: tuning and comparing run all of them from here."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from optim.methods.evolutionary import METHODS as EVOLUTIONARY
from optim.methods.evolutionary import EvolutionSettings, evolve
from optim.methods.manual import manual
from optim.methods.nlp import NlpSettings, solve, solve_from_many
from optim.problem.problem import OptimisationProblem
from optim.problem.tuning_problem import TuningProblem
from optim.search.journal import Journal
from optim.search.search import Search, SearchRun, better
from optim.search.session import SearchSession
from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError, near_names
from spacerobot.scenario import Tuning

ALL = ("manual", *EVOLUTIONARY, "nlp", "nlp_ga")


@dataclass(frozen=True)
class Effort:
    """How much each method may do.

    Attributes
    ----------
    protocol, runs
        Of the evolutionary methods.
    baseline
        Protocol of those that are not the GA.
    nlp, starts, repeats
        Settings of the NLP, its number of starts, and how often it is repeated with another seed.
    seed
        Seed of everything random.
    """

    protocol: EvolutionSettings = field(default_factory=EvolutionSettings)
    baseline: EvolutionSettings = field(default_factory=EvolutionSettings)
    runs: int = 6
    nlp: NlpSettings = field(default_factory=NlpSettings)
    starts: int = 4
    seed: int = 0
    repeats: int = 1


def effort_of(tuning: Tuning, **changes: int | None) -> Effort:
    """Effort that a tuning section asks for.

    Parameters
    ----------
    tuning
        The section.
    **changes
        ``budget``, ``baseline_budget``, ``runs``, ``starts``, ``seed`` and ``repeats`` in its place; None
        leaves it.
    """
    asked = {name: value for name, value in changes.items() if value is not None}
    whole = EvolutionSettings(population=tuning.population, budget=asked.get("budget", tuning.budget))
    baseline_budget = min(whole.budget, asked.get("baseline_budget", tuning.baseline_budget))
    baseline = dataclasses.replace(whole, budget=baseline_budget)
    return Effort(
        whole,
        baseline,
        asked.get("runs", tuning.runs),
        NlpSettings(iterations=tuning.iterations),
        asked.get("starts", tuning.starts),
        asked.get("seed", tuning.seed),
        asked.get("repeats", 1),
    )


@dataclass(frozen=True)
class MethodOutcome:
    """Result of one method.

    Attributes
    ----------
    method
        Its name.
    runs
        Every run, in order.
    """

    method: str
    runs: tuple[SearchRun, ...]

    def __repr__(self) -> str:
        """Runs and the best of them, in one line."""
        return f"<Outcome of {self.method}: {len(self.runs)} runs, best {self.best!r}>"

    @property
    def best(self) -> SearchRun:
        """The best run."""
        best = self.runs[0]
        for run in self.runs[1:]:
            if not np.isfinite(best.objective) or better(
                run.objective, run.violation, best.objective, best.violation
            ):
                best = run
        return best

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its end."""
        return any(run.status == "interrupted" for run in self.runs)


def run_method(
    problem: OptimisationProblem,
    method: str,
    effort: Effort,
    *,
    first: Array | None = None,
    session: SearchSession | None = None,
) -> MethodOutcome:
    """Run a method as often as the effort says.

    Parameters
    ----------
    problem
        The problem; ``manual`` needs a :class:`TuningProblem`.
    method
        One of ``ALL``.
    effort
        How much it may do.
    first
        Start of ``nlp_ga`` in the unit cube (k,): the GA's best.
    session
        Journals, workers and callbacks; no journals and threads of this process if None.

    Raises
    ------
    SpaceRobotError
        If there is no such method, or it lacks what it needs.
    """
    if method not in ALL:
        raise SpaceRobotError(f"no method '{method}', {near_names(method, ALL)}")
    session = session or SearchSession()
    begin = SearchFactory(problem, session)
    if method == "manual":
        if not isinstance(problem, TuningProblem):
            raise SpaceRobotError("the manual procedure tunes a scenario's gains, nothing else")
        return MethodOutcome(method, (manual(begin(method, 0, 0, ""), problem),))
    if method in EVOLUTIONARY:
        return MethodOutcome(method, tuple(session.workers.together(_evolutions(begin, method, effort))))
    if method == "nlp_ga" and first is None:
        raise SpaceRobotError("nlp_ga starts from the GA's best: run ga too")
    return MethodOutcome(method, tuple(session.workers.together(_solutions(begin, method, first, effort))))


@dataclass(frozen=True)
class SearchFactory:
    """Begins searches of one problem, each with a journal of its own."""

    problem: OptimisationProblem
    session: SearchSession

    def __call__(self, name: str, index: int, seed: int, settings: str) -> Search:
        """A search by its name, number, seed and whatever else its values depend on."""
        text = f"{self.problem.fingerprint} {name} {index} {seed} {settings}"
        folder = self.session.place
        path = None if folder is None else folder / f"{name}-{index}.journal"
        journal = Journal(path, hashlib.sha256(text.encode()).hexdigest())
        return Search(self.problem, name, index, seed, journal, self.session.progress)


def _evolutions(begin: SearchFactory, method: str, effort: Effort) -> list[Callable[[], SearchRun]]:
    protocol = effort.protocol if method == "ga" else effort.baseline

    def run(index: int) -> SearchRun:
        seed = effort.seed + index
        return evolve(begin(method, index, seed, protocol.fingerprint(method, seed)), protocol)

    return [partial(run, i) for i in range(effort.runs)]


def _solutions(
    begin: SearchFactory, method: str, first: Array | None, effort: Effort
) -> list[Callable[[], SearchRun]]:
    def from_first() -> SearchRun:
        assert first is not None
        search = begin(method, 0, effort.seed, effort.nlp.fingerprint(first.tolist()))
        return solve(search, first, effort.nlp, warm=True)

    def from_many(index: int) -> SearchRun:
        seed = effort.seed + index
        search = begin(method, index, seed, effort.nlp.fingerprint(effort.starts))
        return solve_from_many(search, effort.nlp, effort.starts)

    return [from_first] if method == "nlp_ga" else [partial(from_many, i) for i in range(effort.repeats)]
