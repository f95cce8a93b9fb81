"""Methods by their names: tuning and comparing run all of them from here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optim.methods.settings import Effort
from optim.methods.tuning_method import MethodRequest, SearchFactory, TuningMethod
from optim.problem.problem import OptimisationProblem
from optim.problem.tuning_problem import TuningProblem
from optim.search.search import SearchRun, better
from optim.search.session import SearchSession
from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from spacerobot.registry import TUNING_METHODS


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
        Its name in :data:`spacerobot.registry.TUNING_METHODS`.
    effort
        How much it may do.
    first
        Start in the unit cube (k,) of a method that starts from another one's best.
    session
        Journals, workers and callbacks; no journals and threads of this process if None.

    Raises
    ------
    SpaceRobotError
        If there is no such method, or it lacks what it needs.
    """
    found: TuningMethod = TUNING_METHODS.find(method)
    if found.starts_from is not None and first is None:
        raise SpaceRobotError(f"{method} starts from the best of {found.starts_from}: run it too")
    session = session or SearchSession()
    request = MethodRequest(problem, SearchFactory(problem, session), effort, first)
    return MethodOutcome(method, tuple(session.workers.together(found.searches(request))))


def refuse_periods(problem: TuningProblem, method: str) -> None:
    """Refuse to tune periods by gradients.

    A gradient by a period is exact, yet of no use over a range: wherever an instant passes another clock's, a
    controller reads another sample, and the objective jumps.

    Parameters
    ----------
    problem, method
        The problem, and the method's name.

    Raises
    ------
    ScenarioError
        If the method uses gradients and a variable sets a period.
    """
    periods = problem.variables.periods
    if periods and TUNING_METHODS.find(method).uses_gradients:
        raise problem.scene.error(
            f"found a period, by which the objective jumps where sample instants change places, and the "
            f"method {method}, which uses gradients; methods: {without_gradients()}",
            f"tuning.variables.{periods[0]}",
        )


def without_gradients() -> str:
    """Names of the methods that solve any problem without gradients."""
    known = TUNING_METHODS.entries().items()
    return ", ".join(name for name, each in known if each.solves_any_problem and not each.uses_gradients)
