"""Pareto front of two terms of a plan's cost.

If one term is the time, the duration is fixed at values spaced evenly between the section's limits and the
rest of the cost is minimised (the constraint method). Otherwise the ratio of the two weights is varied. Each
point is warm-started by a neighbour. A bisection order fixes that neighbour in advance, so that the points do
not depend on the number of workers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from optim.planning.formulation.formulate import plan_section
from optim.planning.search.make_plan import (
    PlanSolution,
    Progress,
    failure_message,
    integrals,
    plan_result,
    plan_tasks,
)
from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult
from optim.planning.search.solve_tasks import SolveTask, run_tasks
from optim.planning.studies.front_terms import check_terms
from spacerobot.common.files import StrPath
from spacerobot.scenario.plan_cost import PlanCost
from spacerobot.scene import Scene

DECADES = 3.0
"""Range of the ratio of the two weights [decades], in total."""
ROUNDING = 1e-6
"""Relative improvement below which two values count as equal."""
Status = Literal["efficient", "dominated", "refused"]


@dataclass(frozen=True, eq=False)
class FrontPoint:
    """One point of a front.

    Attributes:
        name: Name of the point's task and folder.
        changes: Changes of the scenario's plan section for this point, by dotted path.
        values: Duration [s] and the reported value of each term in SI units, by name: the integral for
            propellant, root mean squares over the duration for other integrands, roots for terminal costs;
            empty if refused.
        status: ``dominated`` if another point is no worse in both terms and better in one.
        failure: Reason for the refusal; empty if there is a plan.
        plan: The plan; None if it is refused.
    """

    name: str
    changes: Mapping[str, float]
    values: Mapping[str, float]
    status: Status
    failure: str
    plan: PlanSolution | None


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """A Pareto front.

    Attributes:
        scene: Scene whose plan is varied.
        names: Names of the two terms.
        points: Points from one end of the front to the other.
    """

    scene: Scene
    names: tuple[str, ...]
    points: tuple[FrontPoint, ...]

    @property
    def costs(self) -> dict[str, PlanCost]:
        """The two terms, by name; the duration is included even without a weight."""
        section_costs = plan_section(self.scene).costs
        return {
            name: section_costs[name] if name in section_costs else PlanCost(kind=name, weight=0.0)
            for name in self.names
        }


@dataclass(frozen=True)
class FrontRequest:
    """Request for a front.

    Attributes:
        names: The two terms of the cost; ``time`` may be one.
        count: Number of points.
    """

    names: tuple[str, ...] = ("time", "base_rotation")
    count: int = 9


def make_front(
    scene: Scene,
    front_request: FrontRequest,
    *,
    backend: str = "auto",
    progress: Progress | None = None,
    folder: StrPath | None = None,
    dask: str | None = None,
) -> ParetoFront:
    """Plan every point of a front.

    Args:
        scene: A scene with a ``plan`` section.
        front_request: Terms and points of the front.
        backend, progress, folder, dask: As for :func:`optim.planning.search.make_plan.make_plan`.

    Raises:
        ScenarioError: As :func:`.check_terms`.
    """
    check_terms(scene, front_request.names)
    folder = None if folder is None else Path(folder)
    solver = PlanSolver.of(scene, backend, progress or (lambda _: None), motions=front_request.count)
    requests = _asks(solver, front_request)
    names = [f"point_{k + 1}" for k in range(len(requests))]
    tasks: dict[str, SolveTask] = {}
    for k, parent in bisection_order(len(requests)):
        if parent is None:
            tasks |= plan_tasks(solver, requests[k], names[k])
        else:
            tasks[names[k]] = _after(requests[k], names[parent])
    results = run_tasks(solver, tasks, folder, dask)
    points = [_point(solver, request, results, name) for name, request in zip(names, requests, strict=True)]
    return ParetoFront(scene, front_request.names, tuple(_compared(points, front_request.names)))


def bisection_order(count: int) -> list[tuple[int, int | None]]:
    """Indices of points in bisection order, each with a neighbour that precedes it; None for the first."""
    order: list[tuple[int, int | None]] = []
    gaps = [(-1, count)]
    while gaps:
        low, high = gaps.pop(0)
        if high - low < 2:
            continue
        k = (low + high) // 2
        ends = [end for end in (high, low) if 0 <= end < count]
        order.append((k, min(ends, key=lambda end: abs(end - k), default=None)))
        gaps += [(low, k), (k, high)]
    return order


def _asks(solver: PlanSolver, front_request: FrontRequest) -> list[SolveRequest]:
    """Solve request of each point."""
    weights, plain = solver.problem.weights, solver.request()
    first, second = front_request.names
    if "time" not in front_request.names:
        shares = np.linspace(DECADES / 2, -DECADES / 2, front_request.count) / 2
        return [
            dataclasses.replace(
                plain,
                weights={
                    **weights,
                    first: float(weights[first] * 10**share),
                    second: float(weights[second] * 10**-share),
                },
            )
            for share in shares
        ]
    least, greatest, _ = solver.problem.duration
    times = np.linspace(least, greatest, front_request.count)
    return [dataclasses.replace(plain, duration=(float(t),) * 3) for t in times]


def _after(request: SolveRequest, parent: str) -> SolveTask:
    return SolveTask(lambda results: dataclasses.replace(request, near=results[parent]), (parent,))


def _point(
    solver: PlanSolver, request: SolveRequest, results: Mapping[str, SolveResult], name: str
) -> FrontPoint:
    """Point of the front from a search's result."""
    fault, plain = failure_message(results[name], solver.plan.starts), solver.request()
    changes = {
        f"plan.costs.{key}": value for key, value in request.weights.items() if value != plain.weights[key]
    }
    if request.duration != plain.duration:
        changes["plan.duration"] = request.duration[0]
    if fault is not None:
        return FrontPoint(name, changes, {}, "refused", fault, None)
    plan = plan_result(solver, request, results, name)
    duration, sums = plan.phased_motion.duration_s, dict[str, float]()
    for motion in plan.phased_motion.motions:
        for term, value in integrals(motion).items():
            sums[term] = sums.get(term, 0.0) + value
    values = {
        term: float(solver.plan.costs[term].weighs.reduced(value, duration))
        for term, value in sums.items()
        if term != "time"
    }
    return FrontPoint(name, changes, {"time": duration, **values}, "efficient", "", plan)


def _compared(points: Sequence[FrontPoint], names: tuple[str, ...]) -> list[FrontPoint]:
    """Points with those marked that another point dominates."""
    at = {p.name: np.array([p.values[name] for name in names]) for p in points if p.plan is not None}

    def beaten(name: str) -> bool:
        """Whether another point is no worse in both terms and better in one."""
        term_values = at.get(name)
        return term_values is not None and any(
            (term_values >= other).all() and (term_values > (1 + ROUNDING) * other).any()
            for other in at.values()
        )

    return [dataclasses.replace(p, status="dominated") if beaten(p.name) else p for p in points]
