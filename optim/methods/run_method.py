"""Run of a method by its name, for tuning and for comparisons."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.methods.settings import Effort
from optim.methods.tuning_method import MethodRequest, SearchFactory, TuningMethod
from optim.problem.problem import EvaluationCost, OptimisationProblem
from optim.problem.tuning_problem import TuningProblem
from optim.search.search import SearchRun, better
from optim.search.session import SearchSession
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS
from spacerobot.common.tables import Table


@dataclass(frozen=True)
class MethodOutcome:
    """Result of one method.

    Attributes:
        method: Its name.
        runs: Every run, in order.
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

    def sentences(self, factor: float = 1.0) -> list[str]:
        """Objective times a factor, cost and end of each run."""
        lines = []
        for run in self.runs:
            kkt = "" if run.kkt is None else f", first-order residual {run.kkt:.1e}"
            ended = f"{run.status}{': ' + run.message if run.message else ''}"
            spent = f"{run.cost}, {run.seconds:.1f} s{kkt}"
            lines.append(f"{run.method} {run.index + 1}: {factor * run.objective:.6g}, {spent}; {ended}")
        return lines

    def trials(self) -> Table | None:
        """Steps of the best run as a table; None if its method records none."""
        log = self.best.log
        if not log:
            return None
        heads = list(log[0])
        rows = [["-" if row[h] is None else _cell(row[h]) for h in heads] for row in log]
        return Table(
            f"{self.best.method}, step by step", [LOG_HEADINGS.get(head, head) for head in heads], rows
        )

    def to_data(self) -> dict[str, Any]:
        """Plain data for JSON, without the histories of the runs."""
        runs = [
            {"method": run.method, "index": run.index, "seed": run.seed, "objective": run.objective}
            | {"violation": run.violation, "u": run.u, "kkt": run.kkt}
            | dataclasses.asdict(run.cost)
            | {"seconds": run.seconds, "status": run.status, "message": run.message, "log": run.log}
            for run in self.runs
        ]
        return {"method": self.method, "runs": runs}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> MethodOutcome:
        """Outcome with the content of :meth:`to_data`."""
        return cls(data["method"], tuple(_run_of(run) for run in data["runs"]))

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its end."""
        return any(run.status == "interrupted" for run in self.runs)


LOG_HEADINGS = {"largest_error_m": "largest error [m]", "swings_hz": "swings [1/s]"}
"""Headings of a method's log that are not their keys."""


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _run_of(data: Mapping[str, Any]) -> SearchRun:
    cost = EvaluationCost(**{field.name: data[field.name] for field in dataclasses.fields(EvaluationCost)})
    return SearchRun(
        data["method"],
        data["index"],
        data["seed"],
        np.array(data["u"], dtype=float),
        stored_number(data["objective"]),
        stored_number(data["violation"], np.inf),
        cost,
        data["seconds"],
        data["status"],
        data["message"],
        kkt=data["kkt"],
        log=tuple(data["log"]),
    )


def stored_number(value: float | None, missing: float = np.nan) -> float:
    """Number of a JSON file; null, which replaces NaN and infinity there, becomes ``missing``."""
    return missing if value is None else float(value)


def run_method(
    problem: OptimisationProblem,
    method: str,
    effort: Effort,
    *,
    first: Array | None = None,
    session: SearchSession | None = None,
) -> MethodOutcome:
    """Run a method, with the number of runs that the effort gives.

    Args:
        problem: The problem; ``manual`` needs a :class:`TuningProblem`.
        method: Its name in :data:`spacerobot.common.registry.TUNING_METHODS`.
        effort: Budget of the method.
        first: Start in the unit cube (k,) of a method that starts from another one's best point.
        session: Journals, workers and callbacks; no journals and threads of this process if None.

    Raises:
        SpaceRobotError: If there is no such method, or ``first`` is missing.
    """
    tuning_method: TuningMethod = TUNING_METHODS.find(method)
    if tuning_method.starts_from is not None and first is None:
        raise SpaceRobotError(f"{method} starts from the best of {tuning_method.starts_from}: run it too")
    session = session or SearchSession()
    request = MethodRequest(problem, SearchFactory(problem, session), effort, first)
    return MethodOutcome(method, tuple(session.workers.together(tuning_method.searches(request))))


def refuse_periods(problem: TuningProblem, method: str) -> None:
    """Refuse to tune periods by gradients.

    A gradient by a period is exact, yet of no use over a range: wherever an instant passes another clock's, a
    controller reads another sample, and the objective jumps.

    Args:
        problem, method: The problem, and the method's name.

    Raises:
        ScenarioError: If the method uses gradients and a variable sets a period.
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
    entries = TUNING_METHODS.entries().items()
    return ", ".join(name for name, each in entries if each.solves_any_problem and not each.uses_gradients)
