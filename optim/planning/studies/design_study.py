"""Design study: scenario values that minimise a plan's optimal cost, and the cost's variation with each.

Each design is planned on one mesh, warm-started by the previous design's plan. The gradient of the optimal
cost is that of the Lagrangian (see `cost_sensitivities`). L-BFGS-B, a quasi-Newton method with bounds,
minimises the optimal cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import optimize

from optim.planning.formulation.formulate import plan_section
from optim.planning.search.make_plan import (
    PLAN,
    PlanSolution,
    Progress,
    failure_message,
    make_plan,
    plan_result,
)
from optim.planning.search.plan_solver import PlanSolver, SolveResult
from optim.planning.search.result_store import ResultStore
from optim.planning.search.solve_request import solve_request
from optim.planning.studies.cost_sensitivities import OptimalPoint
from optim.problem.variables import Variables, variables_of
from spacerobot.common.arrays import Array
from spacerobot.common.errors import NoPlanError, ScenarioError
from spacerobot.common.files import StrPath
from spacerobot.scene import Scene, build_scene

DESIGNS = 50
"""Maximum number of designs in the search."""
PRECISE = 1e-7
"""Minimum relative gain in cost of a step, and derivative per range of a variable that counts as zero."""
ENDS = {0: "no slope leads farther", 1: f"{DESIGNS} designs were tried"}
"""Meaning of L-BFGS-B's status codes."""
FIRST = 0.1
"""Length of the first step, in ranges of the variables."""
LOST = 10.0
"""Cost assigned to a design without a plan, relative to the first design's."""


@dataclass(frozen=True, eq=False)
class DesignTrial:
    """A design and the result of planning for it.

    Attributes:
        values: Values of the variables (k,), in the scenario's units.
        cost, slopes: Optimal cost, and its derivatives by the variables (k,); not finite without a plan.
        failure: Reason for the lack of a plan; empty if there is one.
        iterations: Number of the solver's iterations.
    """

    values: Array
    cost: float
    slopes: Array
    failure: str
    iterations: int


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Result of a design study.

    Attributes:
        scene: The original scene.
        variables: Free variables of the study.
        trials: Designs of the search, in order; the first is the original design.
        optimum: The best design.
        sweeps: Designs that differ from the best one in a single variable, by its name, in order of its
            value.
        status: Reason why the search ended.
        plan: Plan of the best design, refined and verified.
    """

    scene: Scene
    variables: Variables
    trials: tuple[DesignTrial, ...]
    optimum: DesignTrial
    sweeps: Mapping[str, tuple[DesignTrial, ...]]
    status: str
    plan: PlanSolution


def make_study(
    scene: Scene,
    points: int = 9,
    *,
    backend: str = "auto",
    progress: Progress | None = None,
    folder: StrPath | None = None,
    dask: str | None = None,
) -> DesignStudy:
    """Find the design with the lowest optimal cost within its bounds, and sweep each variable around it.

    Args:
        scene: A scene whose ``plan`` section names ``design`` variables.
        points: Number of designs of each sweep, from bound to bound.
        backend, progress, folder, dask: As for :func:`optim.planning.search.make_plan.make_plan`; the cluster
            plans the first design.

    Raises:
        ScenarioError: If the section names no variables, or unknown numbers.
        NoPlanError: If the original design or the best one has no plan that passes verification.
    """
    folder = None if folder is None else Path(folder)
    variables = design_variables(scene)
    first = build_scene(scene.scenario, variables.as_changes(variables.start), source=scene.source)
    first_plan = make_plan(first, backend=backend, progress=progress, folder=folder, dask=dask)
    designs = _DesignSearch(variables, first_plan, folder, progress or (lambda _: None))
    status = designs.descend()
    best, trials = designs.best[0], tuple(designs.trials)
    sweeps = {name: designs.sweep(k, points) for k, name in enumerate(variables.names)}
    return DesignStudy(scene, variables, trials, best, sweeps, status, designs.finish())


def design_variables(scene: Scene) -> Variables:
    """Variables of a scene's design study.

    Raises:
        ScenarioError: If there are no variables, they name unknown values, or the plan has several phases.
    """
    plan = plan_section(scene)
    named = plan.design
    if plan.phases:
        message = "a design study takes a plan of one phase; leave them out"
        raise scene.error(message, "plan.phases")
    if not named:
        message = (
            "no variables; give some, as {mass: {paths: robots.arm.links.base.mass, lower: 50, upper: 400}}"
        )
        raise scene.error(message, "plan.design")
    return variables_of(scene, named, "plan.design")


class _DesignSearch:
    """Sequence of planned designs, all on the mesh of the first design's plan."""

    def __init__(
        self, variables: Variables, first_plan: PlanSolution, folder: Path | None, notify: Progress
    ) -> None:
        self.variables, self.begun, self.folder, self.notify = variables, first_plan, folder, notify
        self.intervals = first_plan.motion.intervals
        self.trials: list[DesignTrial] = []
        first_result = SolveResult(
            first_plan.runs,
            first_plan.solution,
            first_plan.phased_motion.meshes,
            first_plan.cost,
            first_plan.verification,
            "",
        )
        self.best = self._planned_for(variables.start, first_result, first_result)

    def descend(self) -> str:
        """Search for the best design; returns the reason why the search ended."""
        variables, size = self.variables, self.best[0].cost or 1.0
        begin = variables.unit(variables.start) / FIRST  # the method's own first step is one long

        def least(x: Array) -> tuple[float, Array]:
            """Optimal cost and its gradient, in units of the first design's cost."""
            u = x * FIRST
            design = self._planned_for(variables.values(u), self.best[2]) if self.trials else self.best
            trial, solver, _ = design
            self.trials.append(trial)
            if solver is None:
                return LOST, np.zeros(len(x))
            if trial.cost < self.best[0].cost:
                self.best = design
            return trial.cost / size, trial.slopes * variables.slope(u) * FIRST / size

        options = {"maxfun": DESIGNS, "ftol": PRECISE, "gtol": PRECISE}
        box = [(0.0, 1 / FIRST)] * len(variables)
        minimum = optimize.minimize(least, begin, jac=True, method="L-BFGS-B", bounds=box, options=options)
        return ENDS.get(int(minimum.status), "nothing better was found along the slopes")

    def sweep(self, k: int, points: int) -> tuple[DesignTrial, ...]:
        """Designs that differ from the best one in variable ``k``, each warm-started by its neighbour."""
        best_values = self.best[0].values
        grid = np.tile(self.variables.unit(best_values), (points, 1))
        grid[:, k] = np.linspace(0.0, 1.0, points)
        values = self.variables.values(grid)
        above = int(np.searchsorted(values[:, k], best_values[k]))
        trials: dict[int, DesignTrial] = {}
        for way in (range(above, points), range(above - 1, -1, -1)):
            near = self.best[2]
            for n in way:
                trials[n], _, near = self._planned_for(values[n], near)
        return tuple(trials[n] for n in range(points))

    def finish(self) -> PlanSolution:
        """The plan of the best design, refined and verified.

        Raises:
            NoPlanError: If it fails the verification.
        """
        _, solver, planned = self.best
        assert solver is not None  # the first design is planned for already
        request = solver.request(near=planned, is_solved=True)
        result = solve_request(solver, request)
        fault = failure_message(result)
        if fault is not None:
            raise NoPlanError(fault, source=solver.scene.source, where="plan.design")
        return plan_result(solver, request, {f"{PLAN}, start": planned, PLAN: result})

    def _planned_for(
        self, values: Array, near: SolveResult, result: SolveResult | None = None
    ) -> tuple[DesignTrial, PlanSolver | None, SolveResult]:
        """Design, solver and result: that given, stored, or solved from ``near``.

        Without a plan there is no solver, and ``near`` is returned as the result.
        """
        variables, base = self.variables, self.begun.scene
        settings = ", ".join(f"{name} {value:.5g}" for name, value in variables.as_mapping(values).items())
        self.notify(f"planning for {settings}")
        changes = variables.as_changes(values) | {"plan.intervals": self.intervals}
        try:
            scene = build_scene(base.scenario, changes, source=base.source)
            solver = PlanSolver.of(scene, self.begun.backend, self.notify)
        except ScenarioError as fault:
            return _lost(values, fault.message, 0), None, near
        request, store = solver.request(near=near, refine=False), ResultStore(self.folder, solver.recipe.key)
        result = result or store.find(request)
        if result is None:
            result = solve_request(solver, request)
            store.add(request, result)
        iterations = sum(solve.iterations for solve in result.runs)
        if result.solution is None:
            return _lost(values, f"no plan was found: {result.cause}", iterations), None, near
        solver_of_solution = solver.keeping_apart(result.apart)
        program = solver_of_solution.interpreted.program(request, result.meshes)
        solution = OptimalPoint(solver_of_solution.scene, program, result.solution)
        tied = [dict.fromkeys(paths, float(v)) for paths, v in zip(variables.paths, values, strict=True)]
        slopes = np.array([solution.slope(numbers) for numbers in tied])
        return DesignTrial(values, result.cost, slopes, "", iterations), solver, result


def _lost(values: Array, fault: str, iterations: int) -> DesignTrial:
    return DesignTrial(values, np.inf, np.full(len(values), np.nan), fault, iterations)
