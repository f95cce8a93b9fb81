"""A search: its evaluations, its best point so far, its cost, and its end."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from optim.problem.problem import Evaluation, EvaluationCost, Linearisation, OptimisationProblem
from optim.search.journal import Journal
from spacerobot.common.arrays import Array

FEASIBLE = 1e-6  # largest violation of a constraint, relative to its limit, that counts as none
NOT_APPLICABLE = "not applicable"
"""Status of a search whose method cannot solve the problem; its message begins with the reason."""
KEPT_BYTES = 100_000  # larger samples and derivatives are not kept in journals but computed anew


@dataclass(frozen=True)
class HistoryPoint:
    """Best value of a search at one time.

    Attributes:
        cost: Spent so far.
        seconds: Spent so far, in evaluations and in the method itself.
        objective: Best so far; infinite if nothing feasible was found yet.
    """

    cost: EvaluationCost
    seconds: float
    objective: float


@dataclass(frozen=True)
class SearchRun:
    """Outcome of one search.

    Attributes:
        method, index, seed: Method, number and seed of the search.
        u: The best point found, in the unit cube (k,).
        objective: Objective there; NaN if every point diverged.
        violation: Largest violation of a constraint there, relative to its limit; infinite if every point
            diverged.
        cost, seconds: Total cost and time [s].
        status, message: Status, and the method's message at the end.
        history: Best so far after each point that improved it, and after each generation or iteration.
        kkt: Residual of the first-order conditions at the best point (NLP only); see
            :mod:`optim.methods.kkt`.
        log: Steps of a method that records them.
        diverged, diverged_at: Number of points whose rollout diverged, and the first of them in the unit cube
            (k,), else None.
    """

    method: str
    index: int
    seed: int
    u: Array
    objective: float
    violation: float
    cost: EvaluationCost
    seconds: float
    status: str
    message: str = ""
    history: tuple[HistoryPoint, ...] = ()
    kkt: float | None = None
    log: tuple[Mapping[str, object], ...] = field(default=())
    diverged: int = 0
    diverged_at: Array | None = None

    def __repr__(self) -> str:
        """Objective and how it ended, in one line."""
        return (
            f"<Run {self.index} of {self.method}: {self.status}, objective {self.objective:.6g}, {self.cost}>"
        )

    @property
    def feasible(self) -> bool:
        """Whether it found a point that violates no constraint."""
        return self.violation <= FEASIBLE


@dataclass(frozen=True)
class SearchProgress:
    """Progress of one search.

    Attributes:
        method, index: Name of the method and index of its run.
        done: Fraction of its budget that is spent.
        objective: Best objective so far.
        seconds, left_s: Time spent and estimated time left [s].
    """

    method: str
    index: int
    done: float
    objective: float
    seconds: float
    left_s: float

    def __str__(self) -> str:
        """Progress in one line, as ``progress=print`` shows it."""
        left = f", about {self.left_s:.0f} s left" if self.left_s == self.left_s else ""
        return (
            f"{self.method} {self.index + 1}, {100 * self.done:.0f} %, best so far {self.objective:.4g}{left}"
        )


Progress = Callable[[SearchProgress], object]


def better(objective: float, violation: float, than_objective: float, than_violation: float) -> bool:
    """Whether a point is better: feasible before infeasible, then by objective, else by violation."""
    if violation <= FEASIBLE or than_violation <= FEASIBLE:
        if (violation <= FEASIBLE) != (than_violation <= FEASIBLE):
            return violation <= FEASIBLE
        return objective < than_objective
    return violation < than_violation


class Search:
    """Evaluations of a problem for one run of a method, with their journal and their cost.

    Args:
        problem: The problem.
        method, index, seed: Name of the method, index of its run and seed of the run.
        journal: Journal of the evaluations; None keeps them in memory only.
        progress: Callback after each evaluation.
    """

    def __init__(
        self,
        problem: OptimisationProblem,
        method: str,
        index: int = 0,
        seed: int = 0,
        journal: Journal | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.problem = problem
        self.method, self.index, self.seed = method, index, seed
        self.cost = EvaluationCost()
        self.u = np.array(problem.start, dtype=float)
        self.objective, self.violation = np.nan, np.inf
        self.history: list[HistoryPoint] = []
        self.share = 0.0
        self.diverged: int = 0
        self.diverged_at: Array | None = None
        self._journal = Journal(None) if journal is None else journal
        self._progress = progress
        self._seconds, self._since = 0.0, time.perf_counter()

    def evaluate(self, u: Array) -> Evaluation:
        """Values at points u (N, k), each counted as a rollout."""
        return self._values("values", self.problem.evaluate, u, EvaluationCost(rollouts=1))

    def sample(self, u: Array) -> Evaluation:
        """Objectives and their residual rows at points u (N, k), at the cost that the problem states."""
        return self._values("samples", self.problem.sample, u, self.problem.sample_cost)

    def linearise(self, u: Array) -> Linearisation:
        """Values and derivatives at one point u (k,), counted as the problem says."""
        return self.linearise_all(u[None])[0]

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Values and derivatives at points u (N, k), each counted as the problem says."""
        u = np.ascontiguousarray(u, dtype=float)
        record = self._journal.replay("linear", u)
        if record is not None and "0 gradient" in record:
            arrays = [dict[str, Array]() for _ in u]
            for name, value in record.items():
                number, space, key = name.partition(" ")
                if space:
                    arrays[int(number)][key] = value
            linearisations = [Linearisation.of_arrays(each) for each in arrays]
        else:
            linearisations = self.problem.linearise_all(u)
        if record is None:
            stored_arrays = {
                f"{i} {name}": a for i, at in enumerate(linearisations) for name, a in at.as_arrays().items()
            }
            self._keep("linear", u, stored_arrays)
        else:
            self._resume(float(record["seconds"]))
        values = [at.as_evaluation() for at in linearisations]
        objective = np.concatenate([each.objective for each in values])
        constraints = np.concatenate([each.constraints for each in values])
        self._note(u, Evaluation(objective, constraints), self.problem.linear_cost)
        return linearisations

    def _values(
        self, kind: str, ask: Callable[[Array], Evaluation], u: Array, each: EvaluationCost
    ) -> Evaluation:
        u = np.ascontiguousarray(np.atleast_2d(u), dtype=float)
        record = self._journal.replay(kind, u)
        if record is not None and "objective" in record:
            evaluation = Evaluation(record["objective"], record["constraints"], record.get("rows"))
        else:
            evaluation = ask(u)
        if record is None:
            values = {
                "objective": evaluation.objective,
                "constraints": evaluation.constraints,
                "rows": evaluation.rows,
            }
            self._keep(kind, u, {name: value for name, value in values.items() if value is not None})
        else:
            self._resume(float(record["seconds"]))
        self._note(u, evaluation, each)
        return evaluation

    def _keep(self, kind: str, u: Array, arrays: Mapping[str, Array]) -> None:
        """Append to the journal; of arrays that are too large only the request."""
        small = sum(value.nbytes for value in arrays.values()) <= KEPT_BYTES
        self._seconds, self._since = self.seconds, time.perf_counter()
        self._journal.append(kind, u, {**(arrays if small else {}), "seconds": np.array(self._seconds)})

    def tell(self, share: float) -> None:
        """Report the share of the budget that is spent.

        Args:
            share: Between 0 and 1.
        """
        self.share = share
        if self._progress is not None:
            spent = self.seconds
            left = spent / share - spent if share > 0 else np.nan
            self._progress(SearchProgress(self.method, self.index, share, self.objective, spent, left))

    @property
    def feasible(self) -> bool:
        """Whether the best point so far violates no constraint."""
        return bool(self.violation <= FEASIBLE)

    @property
    def seconds(self) -> float:
        """Time spent, that of an earlier, killed process included."""
        return self._seconds + time.perf_counter() - self._since

    def finish(self, status: str, message: str = "", **more: object) -> SearchRun:
        """Outcome of the search at its end.

        Args:
            status: Status of the run.
            message: Reason, for a reader.
            **more: Further fields of :class:`SearchRun`.
        """
        return SearchRun(
            self.method,
            self.index,
            self.seed,
            self.u,
            self.objective,
            self.violation,
            self.cost,
            self.seconds,
            status,
            message,
            tuple(self.history),
            diverged=self.diverged,
            diverged_at=self.diverged_at,
            **more,  # type: ignore[arg-type]
        )

    def _note(self, u: Array, evaluation: Evaluation, each: EvaluationCost) -> None:
        """Record points u (N, k) in order, with a history entry for each improvement and for the last one."""
        violation, before = evaluation.violation, self.cost
        for i in range(len(u)):
            value, excess = float(evaluation.objective[i]), float(violation[i])
            self.cost = before + each.times(i + 1)
            if np.isnan(value):
                self.diverged += 1
                self.diverged_at = np.array(u[i]) if self.diverged_at is None else self.diverged_at
            improved = np.isfinite(excess) and better(value, excess, self.objective, self.violation)
            if improved:
                self.u, self.objective, self.violation = np.array(u[i]), value, excess
            if improved or i == len(u) - 1:
                objective_shown = self.objective if self.feasible else np.inf
                self.history.append(HistoryPoint(self.cost, self.seconds, objective_shown))

    def _resume(self, seconds: float) -> None:
        """Set the elapsed time to that which an earlier process had spent up to this record."""
        self._seconds, self._since = seconds, time.perf_counter()
