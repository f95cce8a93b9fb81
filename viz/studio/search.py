"""Improvement of designs: a few gradient steps, or a complete search by a tuning method."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import minimize

from optim.methods.run_method import run_method
from optim.methods.settings import effort_of
from optim.problem.problem import Evaluation, EvaluationCost, Linearisation
from optim.problem.scene_recipe import tuning_of
from optim.problem.tuning_problem import TuningProblem, build_problem
from optim.problem.varied_parameters import LARGE_RATIO
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.registry import TUNING_METHODS
from spacerobot.common.section import is_number
from spacerobot.scene import build_scene
from viz.studio.job import Job, StoppedError
from viz.studio.messages import Request
from viz.studio.metric_slopes import differences
from viz.studio.metrics import Metric
from viz.studio.prepared_design import DesignCache, PreparedDesign

STEPS = 12
"""Maximum number of steps of *improve*."""

MOST_ROLLOUTS = 100_000


@dataclass(frozen=True)
class SearchBox:
    """Box of the numbers that are searched; numbers with widely separated bounds have a log scale.

    Attributes:
        paths: Paths of the k numbers.
        lower, upper: Bounds (k,).
    """

    paths: tuple[str, ...]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, request: Request, plant: PreparedDesign) -> SearchBox:
        """Search box that a request defines.

        Raises:
            ScenarioError: If a path cannot be searched, or its bounds are missing or not valid.
        """
        bounds = request.pairs("bounds")
        if not bounds:
            raise ScenarioError("pin the numbers that may change first")
        for path, ends in bounds.items():
            if path not in plant.free:
                raise ScenarioError("no number that can be searched", where=path)
            finite = [is_number(end) and np.isfinite(end) for end in (ends if isinstance(ends, list) else ())]
            if len(finite) != 2 or not all(finite):
                raise ScenarioError(f"found {ends!r}, allowed: two bounds", where=path)
            if not ends[0] < ends[1]:
                raise ScenarioError(f"lower must be below upper, found {ends[0]:g}, {ends[1]:g}", where=path)
            for end in ends:
                plant.leaves[path].check(end)
        ends = np.array(list(bounds.values()), dtype=float)
        return cls(tuple(bounds), ends[:, 0], ends[:, 1])

    @cached_property
    def log(self) -> np.typing.NDArray[np.bool_]:
        """Whether equal ratios are equal distances (k,)."""
        return (self.lower > 0) & (self.upper >= LARGE_RATIO * np.where(self.lower > 0, self.lower, 1.0))

    def values(self, u: Array) -> Array:
        """Values (k,) at a point of the unit cube."""
        low = np.where(self.log, self.lower, 1.0)
        ratio = np.where(self.log, self.upper / low, 1.0)
        numbers = np.where(self.log, low * ratio**u, self.lower + (self.upper - self.lower) * u)
        return np.clip(numbers, self.lower, self.upper)

    def slope(self, u: Array) -> Array:
        """Derivative (k,) of each value."""
        low = np.where(self.log, self.lower, 1.0)
        logs = self.values(u) * np.log(np.where(self.log, self.upper / low, 1.0))
        return np.where(self.log, logs, self.upper - self.lower)

    def unit(self, values: Sequence[float]) -> Array:
        """Point of the unit cube for values of the numbers, which are clipped to their bounds."""
        inside = np.clip(np.array(values, dtype=float), self.lower, self.upper)
        low = np.where(self.log, self.lower, 1.0)
        ratio = np.where(self.log, self.upper / low, 2.0)  # any but 1 where it is not used
        logs = np.log(np.where(self.log, inside, 1.0) / low) / np.log(ratio)
        return np.where(self.log, logs, (inside - self.lower) / (self.upper - self.lower))

    def plain(self, u: Array) -> dict[str, float]:
        """Values by path."""
        return dict(zip(self.paths, map(float, self.values(u)), strict=True))

    def variables(self) -> dict[str, dict[str, Any]]:
        """The numbers as variables of a tuning section."""
        scales = ("log" if log else "linear" for log in self.log)
        each = zip(self.paths, self.lower, self.upper, scales, strict=True)
        return {
            f"n{i}": {"paths": [path], "lower": float(low), "upper": float(high), "scale": scale}
            for i, (path, low, high, scale) in enumerate(each)
        }


def improve(_: DesignCache, plant: PreparedDesign, numbers: Mapping[str, float], job: Job) -> None:
    """Improve a metric by a few quasi-Newton steps within the bounds, each with a line search.

    Gradients are exact if they exist and are compiled, otherwise differences of rollouts.

    Raises:
        SpaceRobotError: If the request names a metric or number that does not exist.
    """
    box, metric = SearchBox.of(job.request, plant), plant.metrics[job.request.text("metric")]
    nominal = plant.nominal | dict(numbers)
    begin = box.unit([nominal[path] for path in box.paths])
    start = plant.cost(numbers, metric)
    far = 1e3 * (abs(start or 0.0) + 1.0)  # a diverged rollout counts as this: nearer, please
    track = _Track(box, begin, start, job)

    def ask(u: Array) -> tuple[float, Array]:
        """Cost and its gradient (n,) at a point of the unit box."""
        if job.stop.is_set():
            raise StoppedError
        design = {**numbers, **box.plain(u)}
        slopes: Mapping[str, float | None] = {}
        if plant.has_gradients:
            value, slopes, _ = plant.gradient(design, metric)
        else:
            value = plant.cost(design, metric)
        missing = [path for path in box.paths if slopes.get(path) is None] if value is not None else []
        slopes = dict(ChainMap(*differences(plant, design, metric, missing, job.stop.is_set), dict(slopes)))
        track.note(u, np.inf if value is None else value, 1.0)
        track.tell(min(0.95, len(track.curve) / (2 * STEPS)))
        slope = np.array([slopes.get(path) or 0.0 for path in box.paths]) * box.slope(u)
        return (far, np.zeros(len(u))) if value is None else (value, slope)

    limits: Any = {"maxiter": STEPS, "maxfun": 4 * STEPS}
    try:
        ended = minimize(
            ask, begin, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(begin), options=limits
        )
        track.tell(1.0, "converged" if ended.success else f"{ended.nit} steps taken", "done")
    except StoppedError:
        track.tell(1.0, "stopped", "stopped")


class _Track:
    """Best point and history of a search, for progress messages to the page."""

    def __init__(self, box: SearchBox, begin: Array, start: float | None, job: Job) -> None:
        self._box, self._start, self._job = box, np.nan if start is None else start, job
        self._at, self._best, self.spent = begin, np.inf, 0.0
        self.curve: list[tuple[float, float]] = []

    def note(self, u: Array, value: float, rollouts: float) -> None:
        """Record a point that cost a number of rollouts."""
        self.spent += rollouts
        if value < self._best:
            self._best, self._at = float(value), np.clip(np.array(u), 0.0, 1.0)
        if np.isfinite(self._best):
            self.curve.append((self.spent, self._best))

    def tell(self, progress: float, message: str = "", state: str = "running") -> None:
        """Send progress, at a limited rate."""
        if state == "running" and not self._job.is_due:
            return
        best = {"values": self._box.plain(self._at), "objective": self._best} if self.curve else None
        # at most about 300 points of the curve, the last one included
        curve = [*self.curve[: -1 : max(1, len(self.curve) // 300)], *self.curve[-1:]]
        search_state = {"start": self._start, "best": best, "curve": [list(point) for point in curve]}
        self._job.tell(state, always=True, progress=progress, message=message, **search_state)


def methods() -> dict[str, str]:
    """Titles of the tuning methods that a page offers, by name; those with gradients first."""
    offered = [each for each in TUNING_METHODS.entries().values() if each.solves_any_problem]
    return {
        each.name: each.title or each.name for each in sorted(offered, key=lambda m: not m.uses_gradients)
    }


def tune(plants: DesignCache, plant: PreparedDesign, numbers: Mapping[str, float], job: Job) -> None:
    """Improve a metric by a method of tuning.

    Raises:
        SpaceRobotError: If the request names a metric, number or method that does not exist.
    """
    request = job.request
    box, metric = SearchBox.of(request, plant), plant.metrics[request.text("metric")]
    method = request.text("method", tuple(methods()))
    budget = request.count("budget", 2500, MOST_ROLLOUTS)
    # these numbers within their bounds, this metric
    scene = plants.origin.build(plants.changes(request.values))
    section = {"variables": box.variables(), "step": plant.ready.rollout.grid.step_s}
    if metric.key == "tip_error_peak":
        section["objective"] = {"kind": "minimax"}
        objective = None
    else:
        objective = plant.metrics.reduced(metric)
    scene = build_scene(scene.scenario, {"tuning": section}, source=scene.source)
    problem = build_problem(scene, objective=objective)
    track = _Track(box, np.array(problem.start), plant.cost(numbers, metric), job)
    watched = MonitoredProblem(problem, metric, job, track, budget)
    effort = effort_of(tuning_of(problem.scene), budget=budget, baseline_budget=budget, runs=1)
    effort = replace(effort, nlp=replace(effort.nlp, budget=budget))
    outcome = run_method(watched, method, effort)
    state = "stopped" if outcome.interrupted else "done"
    track.tell(1.0, outcome.best.message or outcome.best.status, state)


class MonitoredProblem:
    """Tuning problem whose evaluations report their progress to a page; the page can stop them.

    Args:
        problem, metric: The problem, and the page's metric for its objective.
        job, track: Job that receives the progress, and the record of the best point.
        budget: Maximum number of rollouts.
    """

    def __init__(self, problem: TuningProblem, metric: Metric, job: Job, track: _Track, budget: int) -> None:
        self._problem, self._metric, self._job = problem, metric, job
        self._track, self._budget = track, budget

    def __getattr__(self, name: str) -> Any:
        return getattr(self._problem, name)

    def evaluate(self, u: Array) -> Evaluation:
        """Evaluate the problem, and report to the page."""
        return self._noted(u, self._problem.evaluate(u), EvaluationCost(rollouts=1))

    def sample(self, u: Array) -> Evaluation:
        """Sample the problem, and report to the page."""
        return self._noted(u, self._problem.sample(u), self._problem.sample_cost)

    def linearise(self, u: Array) -> Linearisation:
        """Linearise the problem, and report to the page."""
        return self.linearise_all(u[None])[0]

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Linearise the problem at several points, and report to the page."""
        linearisations = self._problem.linearise_all(u)
        objective = np.array([at.objective for at in linearisations])
        self._noted(u, Evaluation(objective, np.zeros((len(u), 0))), self._problem.linear_cost)
        return linearisations

    def _noted(self, u: Array, evaluation: Evaluation, each: EvaluationCost) -> Evaluation:
        for point, value in zip(np.atleast_2d(u), evaluation.objective, strict=True):
            displayed = self._metric.factor * value if np.isfinite(value) else np.inf
            self._track.note(point, displayed, each.equivalent(4.0))
        self._track.tell(min(0.99, self._track.spent / self._budget))
        if self._job.stop.is_set():
            raise KeyboardInterrupt  # as Ctrl-C does: methods end with what they have
        return evaluation
