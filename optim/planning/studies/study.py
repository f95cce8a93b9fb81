"""A design study: which numbers of a scenario make a plan's least cost least, and how it changes with each.

The least cost of a design is found by planning for it, from the plan of the design before, on one mesh; its
slopes are those of the Lagrangian there. A quasi-Newton method with bounds (L-BFGS-B) follows them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import optimize

from optim.planning.formulation.formulate import plan_of
from optim.planning.searches.bench import Ask, Attempt, Bench
from optim.planning.searches.make import PLAN, Planned, Progress, fault_of, kept_in, make_plan, planned
from optim.planning.searches.search import search
from optim.planning.studies.design import Solution
from optim.problem.variables import Variables, variables_of
from spacerobot.arrays import Array
from spacerobot.errors import NoPlanError, ScenarioError
from spacerobot.files import StrPath
from spacerobot.scene import Scene, build_scene

DESIGNS = 50
"""Tried by the search, at most."""
PRECISE = 1e-7
"""Part of the cost that another step must save, and slope per range of a variable that counts as none."""
ENDS = {0: "no slope leads farther", 1: f"{DESIGNS} designs were tried"}
"""What L-BFGS-B's word for its end means."""
FIRST = 0.1
"""Length of the first step, in ranges of the variables."""
LOST = 10.0
"""What a design without a plan counts as, in costs of the first one."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A design that was planned for.

    Attributes
    ----------
    values
        Of the variables (k,), in the scenario's units.
    cost, slopes
        Least cost, and its derivatives by the variables (k,); not finite where no plan was found.
    fault
        Why there is none.
    iterations
        Of the solver.
    """

    values: Array
    cost: float
    slopes: Array
    fault: str
    iterations: int


@dataclass(frozen=True, eq=False)
class Study:
    """What a design study found.

    Attributes
    ----------
    scene
        The scenario's own.
    variables
        What was free.
    trials
        Designs of the search, in turn; the first is the scenario's own.
    found
        The best of them.
    sweeps
        Designs that differ from that by one variable, by its name, in the order of its values.
    ended
        Why the search ended, in words.
    plan
        The plan of the design that was found, refined and judged.
    """

    scene: Scene
    variables: Variables
    trials: tuple[Trial, ...]
    found: Trial
    sweeps: Mapping[str, tuple[Trial, ...]]
    ended: str
    plan: Planned


def make_study(
    scene: Scene,
    points: int = 9,
    *,
    backend: str = "auto",
    progress: Progress | None = None,
    folder: StrPath | None = None,
    dask: str | None = None,
) -> Study:
    """Find the design with the least cost within its bounds, and sweep each variable around it.

    Parameters
    ----------
    scene
        A scene whose ``plan`` section names ``design`` variables.
    points
        Designs of each sweep, from bound to bound.
    backend, progress, folder, dask
        As for :func:`optim.planning.searches.make.make_plan`; on the cluster the first design is planned for.

    Raises
    ------
    ScenarioError
        If the section names no variables, or numbers that there are not.
    NoPlanError
        If the scenario's own design, or the one that was found, has no plan that holds.
    """
    folder = None if folder is None else Path(folder)
    variables = design_of(scene)
    first = build_scene(scene.scenario, variables.as_changes(variables.start), source=scene.source)
    begun = make_plan(first, backend=backend, progress=progress, folder=folder, dask=dask)
    designs = _Designs(variables, begun, folder, progress or (lambda _: None))
    ended = designs.descend()
    best, trials = designs.best, tuple(designs.trials)
    sweeps = {name: designs.sweep(k, points) for k, name in enumerate(variables.names)}
    return Study(scene, variables, trials, best.trial, sweeps, ended, designs.finish())


def design_of(scene: Scene) -> Variables:
    """Variables of a scene's design study.

    Raises
    ------
    ScenarioError
        If there are none, they name numbers that there are not, or the plan has several phases.
    """
    plan = plan_of(scene)
    named = plan.design
    if plan.phases:
        message = "a design study takes a plan of one phase; leave them out"
        raise ScenarioError(message, source=scene.source, where="plan.phases")
    if not named:
        message = (
            "no variables; give some, as {mass: {paths: robots.arm.links.base.mass, lower: 50, upper: 400}}"
        )
        raise ScenarioError(message, source=scene.source, where="plan.design")
    return variables_of(scene, named, "plan.design")


@dataclass(frozen=True, eq=False)
class _Known:
    """A design with its plan."""

    trial: Trial
    bench: Bench
    ask: Ask
    attempt: Attempt


class _Designs:
    """Designs that are planned for one after the other, on the mesh of the first one's plan."""

    def __init__(self, variables: Variables, begun: Planned, folder: Path | None, tell: Progress) -> None:
        self.variables, self.begun, self.folder, self.tell = variables, begun, folder, tell
        self.intervals = begun.motion.intervals
        self.trials: list[Trial] = []
        given = Attempt(begun.solves, begun.solved, begun.course.meshes, begun.cost, begun.verdict, "")
        first = self._planned_for(variables.start, given, given)
        assert isinstance(first, _Known)  # as the scenario has it, and planned for already
        self.best = first

    def descend(self) -> str:
        """Search for the best design; why that ended, in words."""
        variables, size = self.variables, self.best.trial.cost or 1.0
        begin = variables.unit(variables.start) / FIRST  # the method's own first step is one long

        def least(x: Array) -> tuple[float, Array]:
            """Least cost and its slopes, in costs of the first design."""
            u = x * FIRST
            same = not self.trials
            known = self.best if same else self._planned_for(variables.values(u), self.best.attempt)
            trial = known.trial if isinstance(known, _Known) else known
            self.trials.append(trial)
            if not isinstance(known, _Known):
                return LOST, np.zeros(len(x))
            if trial.cost < self.best.trial.cost:
                self.best = known
            return trial.cost / size, trial.slopes * variables.slope(u) * FIRST / size

        options = {"maxfun": DESIGNS, "ftol": PRECISE, "gtol": PRECISE}
        box = [(0.0, 1 / FIRST)] * len(variables)
        found = optimize.minimize(least, begin, jac=True, method="L-BFGS-B", bounds=box, options=options)
        return ENDS.get(int(found.status), "nothing better was found along the slopes")

    def sweep(self, k: int, points: int) -> tuple[Trial, ...]:
        """Designs that differ from the best one by a variable, each begun with its neighbour's plan."""
        own = self.best.trial.values
        grid = np.tile(self.variables.unit(own), (points, 1))
        grid[:, k] = np.linspace(0.0, 1.0, points)
        values = self.variables.values(grid)
        above = int(np.searchsorted(values[:, k], own[k]))
        found: dict[int, Trial] = {}
        for way in (range(above, points), range(above - 1, -1, -1)):
            near = self.best.attempt
            for n in way:
                known = self._planned_for(values[n], near)
                found[n] = known.trial if isinstance(known, _Known) else known
                near = known.attempt if isinstance(known, _Known) else near
        return tuple(found[n] for n in range(points))

    def finish(self) -> Planned:
        """The plan of the best design, refined and judged.

        Raises
        ------
        NoPlanError
            If it does not hold.
        """
        bench = self.best.bench
        ask = bench.asked(near=self.best.attempt, solved=True)
        attempt = search(bench, ask)
        fault = fault_of(attempt)
        if fault is not None:
            raise NoPlanError(fault, source=bench.scene.source, where="plan.design")
        return planned(bench, ask, {f"{PLAN}, start": self.best.attempt, PLAN: attempt})

    def _planned_for(self, values: Array, near: Attempt, attempt: Attempt | None = None) -> _Known | Trial:
        """A design with its plan, begun with one nearby or given, or without one."""
        variables, base = self.variables, self.begun.scene
        said = ", ".join(f"{name} {value:.5g}" for name, value in variables.as_mapping(values).items())
        self.tell(f"planning for {said}")
        changes = variables.as_changes(values) | {"plan.intervals": self.intervals}
        try:
            scene = build_scene(base.scenario, changes, source=base.source)
            bench = Bench.of(scene, self.begun.backend, self.tell)
        except ScenarioError as fault:
            return _lost(values, fault.message, 0)
        ask, kept = bench.asked(near=near, refine=False), kept_in(self.folder, bench)
        attempt = attempt or kept.find(ask)
        if attempt is None:
            attempt = search(bench, ask)
            kept.add(ask, attempt)
        iterations = sum(solve.iterations for solve in attempt.solves)
        if attempt.solved is None:
            return _lost(values, f"no plan was found: {attempt.blame}", iterations)
        own = bench.keeping_apart(attempt.apart)
        solution = Solution(own.scene, bench.motion(ask, attempt), attempt.solved, own.exact.instants)
        tied = [dict.fromkeys(paths, float(v)) for paths, v in zip(variables.paths, values, strict=True)]
        slopes = np.array([solution.slope(numbers) for numbers in tied])
        return _Known(Trial(values, attempt.cost, slopes, "", iterations), bench, ask, attempt)


def _lost(values: Array, fault: str, iterations: int) -> Trial:
    return Trial(values, np.inf, np.full(len(values), np.nan), fault, iterations)
