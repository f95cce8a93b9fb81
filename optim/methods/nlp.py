"""Nonlinear programming from one or several starts: descents in lockstep with vectorised rollouts."""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from optim.methods.descent import DescentResult, DescentSettings, EvaluationRequest, descend
from optim.methods.kkt import kkt_residual
from optim.methods.local_model import EvaluatedPoint
from optim.methods.settings import NlpSettings
from optim.problem.problem import EvaluationCost, Linearisation
from optim.search.search import FEASIBLE, Search, SearchRun
from spacerobot.common.arrays import Array

GRADIENT, SLOPE = 4.0, 3.0  # rollouts that they cost, about: decides where derivatives come from
RADIUS, WARM_RADIUS = 0.1, 0.02  # of the first step
APART = 0.1  # of the unit cube: starts are at least so far from one another, and from optima found


def solve(search: Search, start: Array, settings: NlpSettings, *, warm: bool = False) -> SearchRun:
    """Descend from one start.

    Args:
        search: Search that evaluates points.
        start: Start (k,) in the unit cube.
        settings: Settings of the solver.
        warm: Whether the start is nearly optimal: first steps are then short.

    Returns:
        Run: Never worse than the start; its status and message say how it ended, its ``kkt`` how well.
    """
    multi = _MultiStart(search, settings, WARM_RADIUS if warm else RADIUS)
    try:
        multi.together(multi.screened(start[None]))
    except KeyboardInterrupt:
        return search.finish("interrupted")
    return multi.finish()


def solve_from_many(search: Search, settings: NlpSettings, starts: int) -> SearchRun:
    """Descend from several starts: the problem's start and the best points of a Sobol sequence.

    The first round has one descent; those after it have 2, 4, ... concurrent ones. They start from the best
    screened points that keep a distance from earlier starts and from the optima found so far.

    Args:
        search: The search, whose seed scrambles the sequence.
        settings: Settings of the descents.
        starts: Maximum number of starts; fewer if the budget is spent.

    Returns:
        Run: The run; its log holds each descent.
    """
    from scipy.stats import qmc

    k = len(search.problem.names)
    sequence = qmc.Sobol(k, rng=np.random.default_rng(search.seed))
    multi = _MultiStart(search, settings, RADIUS, starts)
    started, wave, pool = 0, 1, [np.array(search.problem.start)[None]]
    try:
        while started < starts and not multi.spent:
            wave = min(wave, starts - started)
            if starts > 1:
                pool.append(sequence.random(wave * settings.screen))
            multi.offer(np.concatenate(pool))
            pool = []
            multi.together(multi.chosen(wave))
            started, wave = started + wave, 2 * wave
    except KeyboardInterrupt:
        return search.finish("interrupted", log=tuple(multi.log))
    return multi.finish()


class _MultiStart:
    """Descents of one search."""

    def __init__(self, search: Search, settings: NlpSettings, radius: float, starts: int = 1) -> None:
        self._search, self._settings, self._starts = search, settings, starts
        problem = search.problem
        cheap = problem.form == "smooth" and _price(problem.linear_cost) <= len(problem.names)
        exact = cheap or problem.prefers_exact
        self._manner = DescentSettings(problem.form, exact, radius, settings.iterations, settings.tolerance)
        self._offered: list[EvaluatedPoint] = []
        self._known: list[Array] = []  # starts and optima
        self.ended: list[DescentResult] = []
        self.log: list[dict[str, object]] = []

    @property
    def spent(self) -> bool:
        """Whether the budget is spent."""
        budget = self._settings.budget
        return budget is not None and _price(self._search.cost) >= budget

    def screened(self, u: Array) -> list[EvaluatedPoint]:
        """Points u (N, k) with their values."""
        return EvaluatedPoint.all_of(u, self._search.sample(u))

    def offer(self, u: Array) -> None:
        """Screen points (N, k) that descents may start from."""
        self._offered += self.screened(u)

    def chosen(self, count: int) -> list[EvaluatedPoint]:
        """The best offered points; they are removed from the offer.

        They lie apart from each other, from earlier starts and from optima; if there are too few of these,
        nearer ones follow.
        """
        ranked = sorted(self._offered, key=lambda p: (not p.known, max(p.excess, FEASIBLE), p.objective))
        points: list[EvaluatedPoint] = []
        for apart in (APART, 0.0):
            for point in ranked:
                away = [float(np.abs(point.u - u).max()) for u in self._known]
                if (
                    len(points) < count
                    and not any(point is p for p in points)
                    and min(away, default=1.0) > apart
                ):
                    points.append(point)
                    self._known.append(point.u)
        self._offered = [point for point in self._offered if not any(point is p for p in points)]
        return points

    def together(self, starts: Sequence[EvaluatedPoint]) -> None:
        """Run descents in lockstep, with simultaneous requests evaluated in one batch."""
        running = {i: descend(start, self._manner) for i, start in enumerate(starts)}
        requests: dict[int, EvaluationRequest] = {}
        for i in list(running):
            self._answer(i, running, requests, None, starts[i])
        while requests and not self.spent:
            # answers to all requests, one batch for each kind
            answers_by_start: dict[int, list[EvaluatedPoint] | list[Linearisation]] = {}
            for kind in ("sample", "linearise"):
                who = [i for i, ask in requests.items() if ask.kind == kind]
                if who:
                    u = np.concatenate([requests[i].points for i in who])
                    answers = self.screened(u) if kind == "sample" else self._search.linearise_all(u)
                    begin = 0
                    for i in who:
                        end = begin + len(requests[i].points)
                        answers_by_start[i] = answers[begin:end]
                        begin = end
            requests = {}
            for i in sorted(answers_by_start):
                self._answer(i, running, requests, answers_by_start[i], starts[i])
            # report the share of the starts that are done, or of the budget, whichever is larger
            share, budget = (len(self.ended) + 0.5) / self._starts, self._settings.budget
            if budget is not None:
                share = max(share, _price(self._search.cost) / budget)
            self._search.tell(min(1.0, share))

    def _answer(
        self,
        i: int,
        running: dict[int, Generator[EvaluationRequest, object, DescentResult]],
        requests: dict[int, EvaluationRequest],
        answer: object,
        start: EvaluatedPoint,
    ) -> None:
        """Send an answer to a descent, and store its next request or its result."""
        try:
            requests[i] = running[i].send(answer)
        except StopIteration as stopped:
            ended: DescentResult = stopped.value
            del running[i]
            self.ended.append(ended)
            self._known.append(ended.point.u)
            self.log.append(
                {
                    "start": start.objective,
                    "objective": ended.point.objective,
                    "steps": ended.steps,
                    "status": ended.status,
                    "message": ended.message,
                }
            )

    def finish(self) -> SearchRun:
        """Result of the run, with first-order conditions at the best point from exact derivatives."""
        search, log = self._search, tuple(self.log)
        ended = [e for e in self.ended if e.point.known]
        best = min(
            ended or self.ended,
            key=lambda e: (max(e.point.excess, FEASIBLE), e.point.objective),
            default=None,
        )
        kkt = None
        if np.isfinite(search.objective):
            kkt = kkt_residual(search.u, search.linearise(search.u), search.problem.form)
        if best is None:
            status, message = "budget spent", "before a descent had ended"
        else:
            status, message = best.status, best.message
        if np.isfinite(search.violation) and not search.feasible:
            message = f"a constraint is passed by {100 * search.violation:.3g} %; {message}"
        return search.finish(status, message, kkt=kkt, log=log)


def _price(cost: EvaluationCost) -> float:
    return cost.equivalent(GRADIENT, SLOPE)
