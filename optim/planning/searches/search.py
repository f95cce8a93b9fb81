"""One search for a motion: solved from a guess or a motion nearby, refined, judged."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from optim.planning.formulation.stage import Problem
from optim.planning.searches.bench import Ask, Attempt, Bench, Solve
from optim.planning.searches.failure import bad_start, exhausted, infeasible, soft_rows
from optim.planning.solver.elastic import Elastic
from optim.planning.solver.solvable import Solvable
from optim.planning.solver.solve import TIME_LIMIT, Solved, solve
from optim.planning.transcription.guess import guesses, stretched
from optim.planning.transcription.jumps import cut, may_jump
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Course
from optim.planning.transcription.refine import carried, constrained
from optim.planning.verification.clearance import course_collisions
from optim.planning.verification.curvature import falling
from optim.planning.verification.refinement import refined_meshes
from optim.planning.verification.verdict import Verdict, judge

BARRIER = 1e-4
"""Barrier parameter, in units of the cost's size, to begin with from another problem's solution."""

Meshes = tuple[Mesh, ...]
"""One for each phase."""

RELAXED = 150
"""Iterations of the elastic program at most."""
AIMLESS = (
    "a motion that meets all constraints was found, but no best one; try further first guesses "
    "(`starts: 5`), other `intervals`, or a weight on `joint_acceleration`"
)
"""Message where the search from a feasible motion ends without a solution."""
FEASIBLE = 1e-7
"""Violation of the elastic program's solution that counts as none."""
MOST_SEGMENTS = 40
"""Segments between jumps of the drives from which on a mesh is refined alone."""
DRAWN = 2
"""Guesses that are drawn, at most, to leave a saddle point."""

MANY, COARSER = 40, 4
"""Intervals from which on a first mesh is solved from one that is coarser by a factor."""
STALL = "Stalled"
STALLED_AT, STALLED = 20, 0.25
"""A search whose violation is above this share of its guess's after so many iterations is given up
for one on a coarser mesh; searches that converge soon have reduced it further by then."""


def search(bench: Bench, ask: Ask) -> Attempt:
    """Search for a motion.

    Parameters
    ----------
    bench
        The problem.
    ask
        What is asked for.
    """
    near = ask.near
    run = _Search(bench if near is None else bench.keeping_apart(near.apart), ask)
    if near is not None and ask.solved:
        run.cost, run.blame = near.cost, near.blame
        run.kept, run.cleared = None if near.solved is None else (near.solved, near.meshes), near.solved
    else:
        run.solve(near)
        run.clear()
    verdict = run.refined() if ask.refine and run.kept is not None else None
    solved, meshes = run.kept or (None, bench.meshes(bench.plan.intervals))
    return Attempt(tuple(run.solves), solved, meshes, run.cost, verdict, run.blame, run.bench.apart)


NOTHING = 1e-12
"""Cost that counts as none."""


def _size(cost: float) -> float:
    """What residuals are taken relative to: a cost, or one where there is none, which tells no size."""
    return cost if cost > NOTHING else 1.0


class _Search:
    """Runs of the solver, one after the other."""

    def __init__(self, bench: Bench, ask: Ask) -> None:
        self.bench, self.ask = bench, ask
        self.solves: list[Solve] = []
        self.kept: tuple[Solved, Meshes] | None = None
        self.cleared: Solved | None = None
        self.cost, self.blame, self.why = np.inf, "", ""
        self.deadline = time.thread_time() + bench.plan.time_limit
        self.ended: tuple[Solvable, Solved, Meshes] | None = None
        self.stalled = False

    @property
    def problem(self) -> Problem:
        """The problem of the first phase, as it is asked."""
        return self.bench.problem_of(self.ask)

    def solve(self, near: Attempt | None) -> None:
        """Solve from a motion nearby if there is one, else or where that fails from a first guess."""
        if near is not None and near.solved is not None and len(near.meshes) == 1 + len(self.bench.later):
            self.warm(near)
        if self.kept is None:
            self.cold()
        if self.kept is None:
            self.relaxed()

    def clear(self) -> None:
        """Solve again with keep-out zones for links that collide along what is kept, until none do.

        Most pairs never come near, so that a pair has a constraint only where a motion violates it. What was
        found before is begun with, its multipliers too.
        """
        while self.kept is not None and self.kept[0] is not self.cleared:
            (solved, meshes), bench = self.kept, self.bench
            found = Attempt((), solved, meshes, self.cost, None, "", bench.apart)
            entered = course_collisions(bench.course(self.ask, found), bench.pairs)
            self.bench = bench.keeping_apart(entered)
            if self.bench is bench:
                self.cleared = solved
                return
            bench.tell(f"planning again: {entered[0].words()}")
            self.kept, self.cost = None, np.inf
            near = None
            if len(meshes) == 1 + len(bench.later):  # else forces jump: from a first guess
                programs = (each.program(self.ask, meshes) for each in (bench, self.bench))
                near = dataclasses.replace(
                    found, solved=constrained(solved, *programs), apart=self.bench.apart
                )
            self.solve(near)

    def cold(self) -> None:
        """Solve from a first guess, on the first mesh, and before on a coarser one where that is fine."""
        many = self.bench.plan.intervals
        wanted = self.bench.meshes(many)
        if many < MANY:
            coarser = many // COARSER
            found = self._guessed(wanted, give_up=coarser > 1)
            if self.stalled and not found:
                found = self._guessed(self.bench.meshes(coarser)) and self._finer(wanted)
                if not found:
                    self.kept, self.cost = None, np.inf
                    self._guessed(wanted)
        elif not self._guessed(self.bench.meshes(many // COARSER)) or not self._finer(wanted):
            self.kept, self.cost = None, np.inf
            self._guessed(wanted)
        self._leave()

    def _leave(self) -> None:
        """Solve from drawn guesses where the search ended at a saddle point, and keep what costs less.

        From a symmetric guess, as a turn about its eigenaxis, IPOPT's steps are symmetric too and end there.
        """
        for k in range(1, DRAWN + 1):
            if self.kept is None:
                return
            kept, cost = self.kept, self.cost
            if falling(self.bench.program(self.ask, kept[1]), kept[0], _size(cost)) is None:
                return
            if not self._guessed(kept[1], self.ask.start + k * self.bench.plan.starts) or self.cost >= cost:
                self.kept, self.cost, self.blame = kept, cost, ""

    def warm(self, near: Attempt) -> None:
        """Solve from the solution of a problem with another duration or other weights, on its mesh."""
        assert near.solved is not None
        course, (least, greatest, _) = self.bench.course(self.ask, near), self.problem.duration
        motion, *others = course.motions
        duration = float(np.clip(motion.duration_s, least, greatest))
        course = dataclasses.replace(course, motions=(stretched(motion, self.problem, duration), *others))
        solved = dataclasses.replace(near.solved, barrier=max(near.solved.barrier, BARRIER))
        self._solve(course, near.meshes, solved)

    def refined(self) -> Verdict | None:
        """Verdict on the motion on meshes that become finer until it is good, or as fine as is allowed."""
        jumps = not self.bench.later and not self.bench.name and may_jump(self.problem)
        verdict = None
        while True:
            self.clear()
            if self.kept is None:
                return verdict
            (solved, meshes), bench = self.kept, self.bench
            course = bench.course(self.ask, Attempt((), solved, meshes, self.cost, None, ""))
            bench.tell("replaying the plan")
            program = bench.exact.program(self.ask, meshes)
            verdict = judge(course, program, solved, _size(self.cost), bench.backend)
            if verdict.fine_enough:
                return verdict
            if jumps and len(meshes) < MOST_SEGMENTS:
                pieces = cut(course, self.problem)
                jumps = pieces is not None and self._solve(pieces, tuple(m.mesh for m in pieces.motions))
                if jumps:
                    continue
                self.blame = ""
            finer = refined_meshes(course, verdict, bench.plan.most_intervals, bench.backend)
            if finer is None:
                self.blame = f"no finer mesh is allowed: raise `most_intervals`, {bench.plan.most_intervals}"
                return verdict
            self.why = f" (refined, for {verdict.faults()[-1]})"
            if not self._finer(finer):
                return verdict

    def relaxed(self) -> None:
        """Solve the elastic program where the search ended by itself without a solution.

        What it finds feasible is gone on from; else its multipliers tell which limits keep it from being so.
        """
        if self.ended is None:
            return
        program, solved, meshes = self.ended
        w = solved.w if np.isfinite(solved.w).all() else self._first
        elastic = Elastic(program, soft_rows(program), _size(program.objective(w)))
        self.bench.tell("looking for the least violation")
        found = solve(
            elastic,
            elastic.started(w),
            iterations=min(self.bench.plan.iterations, RELAXED),
            told=lambda k, cost, _: self._late(f"least violation: iteration {k}, {cost:.3g}"),
        )
        own = found.w[: program.size]
        if elastic.violation(found.w) < FEASIBLE and found.converged:
            near = Attempt((), dataclasses.replace(solved, w=own), meshes, 0.0, None, "")
            if not self._solve(self.bench.course(self.ask, near), meshes):
                self.blame = self.blame or AIMLESS
        elif found.converged or not self.blame:
            self.blame = infeasible(elastic, found, solved.status)

    def _late(self, words: str) -> bool:
        """Tell what is being done; whether the time is over, so that no further iteration begins."""
        self.bench.tell(words)
        return time.thread_time() > self.deadline

    def _guessed(self, meshes: Meshes, start: int | None = None, *, give_up: bool = False) -> bool:
        """Solve from a first guess on a mesh, that of the search's start if none is named.

        With ``give_up`` the solver is stopped where it stalls.
        """
        start = self.ask.start if start is None else start
        rng = np.random.default_rng([self.bench.plan.seed, start]) if start else None
        bench = self.bench
        course = guesses(bench.problems_of(self.ask), bench.lobatto, meshes, rng, start)
        impulses = tuple(np.zeros(one.link.impulses) for one in bench.later)
        return self._solve(dataclasses.replace(course, impulses=impulses), meshes, give_up=give_up)

    def _finer(self, wanted: Meshes) -> bool:
        """Solve on a finer mesh from what is kept."""
        assert self.kept is not None
        bench, (solved, meshes) = self.bench, self.kept
        coarse, fine = (bench.program(self.ask, each) for each in (meshes, wanted))
        course = bench.course(self.ask, Attempt((), solved, meshes, self.cost, None, ""))
        finer = course.on(bench.lobatto, wanted)
        return self._solve(finer, wanted, carried(solved, coarse, fine))

    def _solve(
        self, course: Course, meshes: Meshes, warm: Solved | None = None, *, give_up: bool = False
    ) -> bool:
        bench, costs, violations = self.bench, list[float](), list[float]()
        program = bench.program(self.ask, meshes)
        intervals = sum(mesh.intervals for mesh in meshes)
        many = f"start {self.ask.start + 1} of {bench.plan.starts}, " if bench.plan.starts > 1 else ""
        words = f"solving: {many}{intervals} intervals{self.why}"

        def told(iteration: int, cost: float, violation: float) -> bool:
            """Note an iteration, and tell of it."""
            costs.append(cost)
            violations.append(violation)
            late = self._late(f"{words}, iteration {iteration}, cost {cost:.4g}, violation {violation:.1e}")
            self.stalled = give_up and len(violations) == STALLED_AT and violation > STALLED * violations[0]
            return late or self.stalled

        first = self._first = course.unknowns
        self.ended, fault = None, bad_start(program, first)
        if fault is not None:
            self.blame = fault
            return False
        guessed = program.objective(first)
        scale = _size(self.cost if np.isfinite(self.cost) else guessed)
        solved = solve(program, first, warm, scale=scale, iterations=bench.plan.iterations, told=told)
        cost, converged = program.objective(solved.w), solved.converged
        self.solves.append(
            Solve(
                self.ask.start,
                intervals,
                cost,
                STALL if self.stalled else solved.status,
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
        else:
            self.blame = exhausted(program, solved, bench.plan)
            self.ended = None if solved.status == TIME_LIMIT else (program, solved, meshes)
        return converged
