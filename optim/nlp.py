"""Nonlinear programming with IPOPT from one start or several, over exact gradients."""

from __future__ import annotations

import dataclasses
import hashlib
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from optim.kkt import kkt_residual
from optim.protocol import Array, Evaluation, Linearisation
from optim.search import FEASIBLE, Run, Search
from optim.shooting import Shooting, Solution

OPTIMAL = 1e-4  # first-order residual from which a point that no longer improves counts as an optimum
FAR = 1e-2  # residual from which it does not: a nearly optimal start then gets as many iterations again
CALM = 3  # iterations without improvement after which the residual is looked at
ROUND_GAIN = 3.0  # IPOPT is started again, scaled anew, after a round that divided the objective by this

STATUS = {
    "Solve_Succeeded": ("converged", "first-order conditions met"),
    "Solved_To_Acceptable_Level": ("converged", "first-order conditions met, more loosely than asked for"),
    "User_Requested_Stop": ("settled", "no further improvement"),
    "Maximum_Iterations_Exceeded": ("iterations spent", "the best point so far is kept"),
    "Search_Direction_Becomes_Too_Small": ("settled", "steps became too small to change anything"),
    "Infeasible_Problem_Detected": ("infeasible", "no nearby point meets the constraints"),
    "Restoration_Failed": ("failed", "no step was found that meets the constraints better; likely at a kink"),
    "Invalid_Number_Detected": ("failed", "the rollout diverges at the start or at every step from it"),
    "Error_In_Step_Computation": ("failed", "no step could be computed; the problem is badly scaled here"),
    "Diverging_Iterates": ("failed", "the iterates left every bound"),
}


@dataclass(frozen=True)
class NlpSettings:
    """How an NLP is solved.

    Attributes
    ----------
    iterations
        At most, from one start.
    tolerance
        Of the first-order conditions, relative to the objective at the start.
    patience, improvement
        Stop after so many iterations without a relative improvement of the best point by so much.
    rounds
        IPOPT is started again from where it ended, scaled anew, after a round that gained much.
    screen
        Points of a Sobol sequence that are tried, in one batch, to choose starts from.
    """

    iterations: int = 100
    tolerance: float = 1e-5
    patience: int = 10
    improvement: float = 1e-3
    rounds: int = 4
    screen: int = 64

    def fingerprint(self, start: Array) -> str:
        """What a journal of such a run depends on beside the problem."""
        return hashlib.sha256(repr((self, start.tolist())).encode()).hexdigest()


def solve(search: Search, start: Array, settings: NlpSettings, *, warm: bool = False) -> Run:
    """Search with IPOPT from one start.

    Parameters
    ----------
    search
        What evaluates.
    start
        Start (k,) in the unit cube.
    settings
        How.
    warm
        Whether the start is nearly optimal: IPOPT then keeps close to it, also to bounds, and is given twice
        the patience.

    Returns
    -------
    Run
        Never worse than the start; its status and message say how IPOPT ended, its ``kkt`` how well.
    """
    u, found, guard = start, None, None
    if warm:
        settings = dataclasses.replace(settings, patience=2 * settings.patience)
    try:
        for attempt in range(settings.rounds):
            first = search.linearise(u)
            guard = guard or _Guard(search, settings, first, warm=warm)
            if not np.isfinite(first.as_evaluation().violation[0]):
                return search.finish("failed", "the rollout diverges at the start")
            shooting = Shooting(search.problem.form, guard.linearise, first)
            with guard.deferring():
                found = shooting.solve(
                    u, _options(settings, guard.left, warm=warm or attempt > 0), guard.stop
                )
            if guard.interrupted:
                return search.finish("interrupted")
            if guard.left <= 0 or not 0 < ROUND_GAIN * search.objective < first.objective:
                break
            u = search.u
            guard.rest()
    except KeyboardInterrupt:
        return search.finish("interrupted")
    return _finish(search, found, guard)


def _finish(search: Search, found: Solution | None, guard: _Guard | None) -> Run:
    """The run, its first-order conditions judged at the best point (not where IPOPT happened to stop)."""
    if found is None or guard is None:
        return search.finish("failed", "no iteration was asked for")
    status, meaning = STATUS.get(found.status, ("failed", "see IPOPT's own documentation"))
    if guard.optimal:
        status, meaning = "converged", "first-order conditions met"
    kkt = None
    if np.isfinite(search.objective):
        at = search.linearise(search.u)
        kkt = kkt_residual(search.u, at, search.problem.form)
    message = f"{meaning} ({found.status}, {guard.iterations} iterations)"
    if np.isfinite(search.violation) and not search.feasible:
        message = f"a constraint is passed by {100 * search.violation:.3g} %; {message}"
    return search.finish(status, message, kkt=kkt)


def _options(settings: NlpSettings, iterations: int, *, warm: bool) -> dict[str, object]:
    more: dict[str, object] = {"mu_init": 1e-3, "bound_push": 1e-4, "bound_frac": 1e-4} if warm else {}
    return more | {
        "print_level": 0,
        "sb": "yes",
        "tol": settings.tolerance,
        "acceptable_tol": 30 * settings.tolerance,
        "acceptable_iter": 5,
        "max_iter": iterations,
        "mu_strategy": "adaptive",
        "bound_relax_factor": 0.0,
        "nlp_scaling_method": "none",
    }


_ARRAYS = ("gradient", "constraints", "constraint_jacobian", "rows", "rows_jacobian", "smooth_gradient")


class _Guard:
    """Stands between IPOPT and the search: no exception may cross it, and stalling ends the search."""

    def __init__(self, search: Search, settings: NlpSettings, first: Linearisation, *, warm: bool) -> None:
        self._search, self._settings, self._last = search, settings, first
        self._at_best, self._warm, self._extended = first, warm, False
        self.optimal = False
        self.iterations, self._since, self._best = 0, 0, np.inf
        self._reached = np.inf  # by IPOPT itself, which leaves a start near a bound for the inside
        self._violation, self._least = np.inf, np.inf  # while no point has met the constraints yet
        self.interrupted = False

    @property
    def left(self) -> int:
        """Iterations that may still be done."""
        return self._settings.iterations - self.iterations

    def rest(self) -> None:
        """Begin to count iterations without improvement anew."""
        self._since = 0

    def linearise(self, u: Array) -> Linearisation:
        """The search's own; without values where the rollout diverged, and once it was interrupted."""
        try:
            if not self.interrupted:
                found = self._search.linearise(u)
                if np.array_equal(self._search.u, u):
                    self._at_best = found
                violation = float(found.as_evaluation().violation[0])
                self._violation = min(self._violation, violation)
                if violation <= FEASIBLE:
                    self._reached = min(self._reached, found.objective)
                if np.isfinite(violation):
                    self._last = found
                    return found
        except KeyboardInterrupt:
            self.interrupted = True
        nothing = {name: np.full_like(getattr(self._last, name), np.nan) for name in _ARRAYS}
        return dataclasses.replace(self._last, objective=np.nan, smooth=np.nan, **nothing)

    @contextmanager
    def deferring(self) -> Iterator[None]:
        """While IPOPT runs, Ctrl-C asks it to stop: an exception would be lost on its way through C++."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def interrupt(_signal: int, _frame: object) -> None:
            self.interrupted = True

        before = signal.signal(signal.SIGINT, interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before if before is not None else signal.default_int_handler)

    def stop(self) -> bool:
        """Whether IPOPT shall end, asked after each iteration."""
        self.iterations += 1
        search, settings = self._search, self._settings
        search.tell(min(1.0, self.iterations / settings.iterations))
        self._since = 0 if self._improved() else self._since + 1
        if search.feasible and self._since >= (settings.patience if self._warm else CALM):
            residual = kkt_residual(search.u, self._at_best, search.problem.form)
            self.optimal = residual <= OPTIMAL
            if self._warm and not self._extended and residual > FAR:
                self._since, self._extended = 0, True
        return self.interrupted or self.optimal or self._since >= settings.patience

    def _improved(self) -> bool:
        """Whether the best point became better by enough; the least infeasible one until one is feasible."""
        gain = self._settings.improvement
        if not np.isfinite(self._reached):
            better = self._violation < self._least * (1 - gain)
            self._least = self._violation if better else self._least
            return better
        better = not self._reached >= self._best * (1 - np.sign(self._best) * gain)
        self._best = self._reached if better else self._best
        return better


def choose_starts(search: Search, count: int, settings: NlpSettings) -> list[Array]:
    """Starts that are good and far apart: the problem's own, then the best of a screened Sobol sequence.

    Parameters
    ----------
    search
        What evaluates; its seed scrambles the sequence.
    count
        How many; a single one is the problem's own, and nothing is screened.
    settings
        How many points are screened.
    """
    if count == 1:
        return [np.array(search.problem.start)]
    from scipy.stats import qmc

    k = len(search.problem.names)
    power = int(np.ceil(np.log2(max(settings.screen, 2 * count))))
    points = qmc.Sobol(k, rng=np.random.default_rng(search.seed)).random_base2(power)
    found: Evaluation = search.evaluate(points)
    ranked = np.lexsort((found.objective, np.maximum(found.violation, FEASIBLE)))
    order = [i for i in ranked if np.isfinite(found.violation[i])]
    starts = [np.array(search.problem.start)]
    for apart in (0.5, 0.25, 0.0):
        for i in order:
            distance = min(float(np.abs(points[i] - start).max()) for start in starts)
            if len(starts) < count and distance > apart:
                starts.append(points[i])
    return starts[:count]
