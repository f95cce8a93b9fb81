"""A plan from beginning to end: formulated, solved from several starts, refined, judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.planning.early import check_reach, check_start
from optim.planning.formulate import formulate, plan_of
from optim.planning.functions import Instants, build_instants
from optim.planning.guess import guess
from optim.planning.lobatto import Lobatto
from optim.planning.motion import Motion
from optim.planning.program import Program
from optim.planning.refine import carried
from optim.planning.solve import Solved, solve
from optim.planning.stage import Problem
from optim.planning.verdict import Verdict, judge
from spacerobot.arrays import Array
from spacerobot.errors import NoPlanError
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Solve:
    """One run of the solver.

    Attributes
    ----------
    start
        Which start it came from.
    intervals
        Of its mesh.
    cost
        Where it ended.
    solved
        How.
    """

    start: int
    intervals: int
    cost: float
    solved: Solved


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion, what was done for it, and what is to be thought of it.

    Attributes
    ----------
    scene, motion
        The scene and its motion.
    cost, terms
        Cost, and its parts by name.
    solves
        Every run of the solver, in turn.
    verdict
        On the motion.
    backend
        ``compiled`` or ``interpreted``: what evaluated the problem's functions.
    """

    scene: Scene
    motion: Motion
    cost: float
    terms: Mapping[str, float]
    solves: tuple[Solve, ...]
    verdict: Verdict
    backend: str


def make_plan(scene: Scene, *, backend: str = "auto", progress: Progress | None = None) -> Planned:
    """Plan what a scene's ``plan`` section asks for.

    Parameters
    ----------
    scene
        The scene.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    progress
        Called with a few words whenever something that may take a while begins.

    Raises
    ------
    ScenarioError
        If the section asks for what cannot be.
    NoPlanError
        If no motion was found, naming what stands against it, or the one found does not hold.
    """
    tell = progress or (lambda _: None)
    plan = plan_of(scene)
    problem = formulate(scene)
    check_start(problem)
    check_reach(problem, plan, {tip.label: tip for tip in scene.tips})
    tell("compiling the problem's functions, or finding them compiled")
    instants = build_instants(problem, backend)
    search = _Search(problem, plan, instants, backend, tell)
    search.from_starts()
    planned = search.refined(scene)
    faults = planned.verdict.faults()
    if faults:
        raise NoPlanError(f"the plan is refused: {'; '.join(faults)}", source=scene.source, where="plan")
    return planned


class _Search:
    """Runs of the solver over one problem."""

    def __init__(
        self, problem: Problem, plan: Planning, instants: Instants, backend: str, tell: Progress
    ) -> None:
        self.problem, self.plan, self.instants = problem, plan, instants
        self.backend, self.tell = backend, tell
        self.lobatto = Lobatto.of_order(plan.order)
        self.solves: list[Solve] = []
        self.motion: Motion | None = None
        self.last: Solved | None = None
        self.program: Program | None = None
        self.cost = np.inf

    def from_starts(self) -> None:
        """Solve from every start on the first mesh, and keep the best.

        Raises
        ------
        NoPlanError
            If none ends feasible.
        """
        plan = self.plan
        worst = ""
        for k in range(plan.starts):
            rng = np.random.default_rng([plan.seed, k]) if k else None
            motion = guess(self.problem, self.lobatto, plan.intervals, rng)
            found, program = self._solve(motion, k)
            if found.solved.converged and found.cost < self.cost:
                self._keep(program, found)
            elif not found.solved.converged:
                worst = worst or blame(program, found.solved)
        if self.motion is None:
            many = f" from {plan.starts} starts" if plan.starts > 1 else ""
            raise NoPlanError(
                f"no feasible plan was found{many}; what stands against it: {worst}",
                source=self.problem.stage.scene.source,
                where="plan",
            )

    def refined(self, scene: Scene) -> Planned:
        """Best motion on meshes that become finer until its verdict is good, or as fine as is allowed."""
        while True:
            assert self.motion is not None
            assert self.last is not None
            self.tell("replaying the plan")
            verdict = judge(self.motion, self.last, self.cost, self.backend)
            finer = 2 * self.motion.intervals
            if verdict.fine_enough or finer > self.plan.most_intervals:
                break
            found, program = self._solve(self.motion.on(self.lobatto, finer), self.solves[-1].start)
            if not found.solved.converged:
                break
            self._keep(program, found)
        terms = _terms(self.motion)
        return Planned(
            scene, self.motion, self.cost, terms, tuple(self.solves), verdict, self.instants.backend
        )

    def _solve(self, motion: Motion, start: int) -> tuple[Solve, Program]:
        program = Program(self.problem, self.instants, self.lobatto, motion.intervals)
        which = f"start {start + 1} of {self.plan.starts}, " if self.plan.starts > 1 else ""
        words = f"solving: {which}{motion.intervals} intervals"

        def told(iteration: int, cost: float, violation: float) -> None:
            self.tell(f"{words}, iteration {iteration}, cost {cost:.4g}, violation {violation:.1e}")

        first = motion.unknowns
        scale = self.cost if np.isfinite(self.cost) else max(program.objective(first), 1e-12)
        warm = None
        if self.last is not None and self.program is not None and motion.intervals != self.plan.intervals:
            warm = carried(self.last, self.program, program)
        solved = solve(program, first, warm, scale=scale, iterations=self.plan.iterations, told=told)
        found = Solve(start, motion.intervals, program.objective(solved.w), solved)
        self.solves.append(found)
        return found, program

    def _keep(self, program: Program, found: Solve) -> None:
        z, duration = program.split(found.solved.w)
        self.motion = Motion(self.problem, self.lobatto, found.intervals, duration, z)
        self.last, self.program, self.cost = found.solved, program, found.cost


def blame(program: Program, solved: Solved) -> str:
    """Constraints that are violated most where a search ended, by name with their violations."""
    g, (least, greatest) = program.constraints(solved.w), program.limits()
    over = np.maximum(np.maximum(least - g, g - greatest), 0.0)
    problem, found = program.problem, dict[str, tuple[float, str]]()
    inside = over[program.defects : program.rows - len(problem.goal)].reshape(
        program.points, program.per_point
    )
    found["equations of motion"] = (float(inside[:, : program.nv].max()), "N or N m")
    found["continuity"] = (float(over[: program.defects].max()), "m or rad")
    for k, row in enumerate(problem.path):
        found[row.name] = (float(inside[:, program.nv + k].max()) * row.scale, row.unit)
    for row, value in zip(problem.goal, over[program.rows - len(problem.goal) :], strict=True):
        found[row.name] = (float(value) * row.scale, row.unit)
    worst = sorted(found.items(), key=lambda item: -item[1][0])
    named = [f"{name} ({value:.2g} {unit})" for name, (value, unit) in worst if value > 1e-6][:4]
    return ", ".join(named) or f"none is violated where the search ended ({solved.status})"


def _terms(motion: Motion) -> dict[str, float]:
    """Parts of the cost."""
    import casadi as ca

    problem = motion.problem
    found: dict[str, float] = {}
    weights: Array = np.zeros(len(motion.z))
    inner = motion.lobatto.points - 1
    for n in range(motion.intervals):
        weights[n * inner : n * inner + inner + 1] += motion.lobatto.weights
    for name, term in problem.terms.items():
        values = np.array(
            ca.Function("term", [problem.stage.z], [ca.densify(term)])(motion.z.T).full()
        ).ravel()
        found[name] = float(weights @ values) * motion.duration_s / motion.intervals
    if problem.time_weight:
        found["time"] = problem.time_weight * motion.duration_s
    return found


def statistics(planned: Planned) -> list[dict[str, Any]]:
    """What each run of the solver took, plain."""
    return [
        {
            "start": one.start,
            "intervals": one.intervals,
            "cost": one.cost,
            "status": one.solved.status,
            "iterations": one.solved.iterations,
            "evaluations_s": one.solved.evaluations_s,
            "seconds": one.solved.seconds,
        }
        for one in planned.solves
    ]
