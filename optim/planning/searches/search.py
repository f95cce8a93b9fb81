"""One search for a motion: solved from a guess or a motion nearby, refined, judged."""

from __future__ import annotations

import dataclasses

import numpy as np

from optim.planning.searches.bench import Ask, Attempt, Bench, Solve
from optim.planning.solver.solvable import Solvable
from optim.planning.solver.solve import Solved, solve
from optim.planning.transcription.chain import programs_of
from optim.planning.transcription.guess import guesses, stretched
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Course
from optim.planning.transcription.program import Program
from optim.planning.transcription.refine import carried
from optim.planning.verification.refinement import refined_meshes
from optim.planning.verification.verdict import Verdict, judge
from spacerobot.arrays import Array

BARRIER = 1e-4
"""Barrier parameter, in units of the cost's size, to begin with from another problem's solution."""

Meshes = tuple[Mesh, ...]
"""One for each phase."""

MANY, COARSER = 40, 4
"""Intervals from which on a first mesh is solved from one that is coarser by a factor."""


def search(bench: Bench, ask: Ask) -> Attempt:
    """Search for a motion.

    Parameters
    ----------
    bench
        The problem.
    ask
        What is asked for.
    """
    run, near = _Search(bench, ask), ask.near
    if near is not None and ask.solved:
        run.cost, run.blame = near.cost, near.blame
        run.kept = None if near.solved is None else (near.solved, near.meshes)
    else:
        if near is not None and near.solved is not None:
            run.warm(near)
        if run.kept is None:
            run.cold()
    verdict = run.refined() if ask.refine and run.kept is not None else None
    solved, meshes = run.kept or (None, bench.meshes(bench.plan.intervals))
    return Attempt(tuple(run.solves), solved, meshes, run.cost, verdict, run.blame)


NOTHING = 1e-12
"""Cost that counts as none."""


def _size(cost: float) -> float:
    """What residuals are taken relative to: a cost, or one where there is none, which tells no size."""
    return cost if cost > NOTHING else 1.0


class _Search:
    """Runs of the solver, one after the other."""

    def __init__(self, bench: Bench, ask: Ask) -> None:
        self.bench, self.ask, self.problem = bench, ask, bench.problem_of(ask)
        self.solves: list[Solve] = []
        self.kept: tuple[Solved, Meshes] | None = None
        self.cost, self.blame = np.inf, ""

    def cold(self) -> None:
        """Solve from a first guess, on the first mesh, and before on a coarser one where that is fine."""
        many = self.bench.plan.intervals
        wanted = self.bench.meshes(many)
        if many < MANY:
            self._guessed(wanted)
        elif not self._guessed(self.bench.meshes(many // COARSER)) or not self._finer(wanted):
            self.kept, self.cost = None, np.inf
            self._guessed(wanted)

    def warm(self, near: Attempt) -> None:
        """Solve from the solution of a problem with another duration or other weights, on its mesh."""
        assert near.solved is not None
        course, (least, greatest, _) = self.bench.course(self.ask, near), self.problem.duration
        motion, *others = course.motions
        duration = float(np.clip(motion.duration_s, least, greatest))
        motion, barrier = stretched(motion, self.problem, duration), max(near.solved.barrier, BARRIER)
        self._solve(
            dataclasses.replace(course, motions=(motion, *others)),
            near.meshes,
            dataclasses.replace(near.solved, barrier=barrier),
        )

    def refined(self) -> Verdict:
        """Verdict on the motion on meshes that become finer until it is good, or as fine as is allowed."""
        bench = self.bench
        while True:
            assert self.kept is not None
            solved, meshes = self.kept
            course = bench.course(self.ask, Attempt((), solved, meshes, self.cost, None, ""))
            bench.tell("replaying the plan")
            program = bench.exact.program(self.ask, meshes)
            verdict = judge(course, program, solved, _size(self.cost), bench.backend)
            if verdict.fine_enough:
                return verdict
            finer = refined_meshes(course, verdict, bench.plan.most_intervals, bench.backend)
            if finer is None or not self._finer(finer):
                return verdict

    def _guessed(self, meshes: Meshes) -> bool:
        """Solve from a first guess on a mesh."""
        start = self.ask.start
        rng = np.random.default_rng([self.bench.plan.seed, start]) if start else None
        bench = self.bench
        course = guesses(bench.problems_of(self.ask), bench.lobatto, meshes, rng)
        impulses = tuple(np.zeros(one.link.impulses) for one in bench.later)
        return self._solve(dataclasses.replace(course, impulses=impulses), meshes)

    def _finer(self, wanted: Meshes) -> bool:
        """Solve on a finer mesh from what is kept."""
        assert self.kept is not None
        bench, (solved, meshes) = self.bench, self.kept
        coarse, fine = (bench.program(self.ask, each) for each in (meshes, wanted))
        course = bench.course(self.ask, Attempt((), solved, meshes, self.cost, None, ""))
        finer = course.on(bench.lobatto, wanted)
        return self._solve(finer, wanted, carried(solved, coarse, fine))

    def _solve(self, course: Course, meshes: Meshes, warm: Solved | None = None) -> bool:
        bench, costs, violations = self.bench, list[float](), list[float]()
        program = bench.program(self.ask, meshes)
        intervals = sum(mesh.intervals for mesh in meshes)
        many = f"start {self.ask.start + 1} of {bench.plan.starts}, " if bench.plan.starts > 1 else ""
        words = f"solving: {many}{intervals} intervals"

        def told(iteration: int, cost: float, violation: float) -> None:
            """Note an iteration, and tell of it."""
            costs.append(cost)
            violations.append(violation)
            bench.tell(f"{words}, iteration {iteration}, cost {cost:.4g}, violation {violation:.1e}")

        first = course.unknowns
        guessed = program.objective(first)
        scale = _size(self.cost if np.isfinite(self.cost) else guessed)
        solved = solve(program, first, warm, scale=scale, iterations=bench.plan.iterations, told=told)
        cost, converged = program.objective(solved.w), solved.converged
        self.solves.append(
            Solve(
                self.ask.start,
                intervals,
                cost,
                solved.status,
                converged,
                solved.iterations,
                solved.evaluations_s,
                solved.seconds,
                tuple(costs),
                tuple(violations),
            )
        )
        if converged:
            self.kept, self.cost, self.blame = (solved, meshes), cost, ""
        elif self.kept is None:
            self.blame = blame(program, solved)
        return converged


def blame(program: Solvable, solved: Solved) -> str:
    """Constraints that are violated most where a search ended, by name with their violations."""
    g, (least, greatest) = program.constraints(solved.w), program.limits()
    over, found = np.maximum(np.maximum(least - g, g - greatest), 0.0), dict[str, tuple[float, str]]()
    first = 0
    for one in programs_of(program):
        for name, (value, unit) in _violated(one, over[first : first + one.rows]).items():
            found[name] = max((value, unit), found.get(name, (0.0, unit)))
        first += one.rows
    if first < program.rows:
        found["continuity between phases"] = (float(over[first:].max()), "m or rad")
    worst = sorted(found.items(), key=lambda item: -item[1][0])
    named = [f"{name} ({value:.2g} {unit})" for name, (value, unit) in worst if value > 1e-6][:4]
    return ", ".join(named) or f"none is violated where the search ended ({solved.status})"


def _violated(program: Program, over: Array) -> dict[str, tuple[float, str]]:
    """Greatest violations of one phase's constraints, and their units, by name."""
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
    return found
