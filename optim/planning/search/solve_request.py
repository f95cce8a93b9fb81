"""Search for one trajectory: solve from a guess or a nearby solution, refine, verify."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass

import numpy as np

from optim.planning.formulation.stage import PlanningProblem, state_after_impact
from optim.planning.search.failure_messages import (
    bad_guess_message,
    infeasibility_message,
    limit_message,
    soft_rows,
)
from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult, SolverRun
from optim.planning.solver.elastic import ElasticProgram
from optim.planning.solver.ipopt import TIME_LIMIT, Solution, solve
from optim.planning.transcription.drive_jumps import split_at_jumps
from optim.planning.transcription.initial_guess import initial_guess, is_guided, rescaled_motion
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.mesh_transfer import transfer, transfer_constrained
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.transcription.phase_chain import PhaseChain
from optim.planning.verification.mesh_refinement import refined_meshes, sharper_meshes
from optim.planning.verification.second_order_conditions import descent_direction
from optim.planning.verification.verify import VerificationResult, course_collisions, verify

BARRIER = 1e-4
"""Barrier parameter relative to the cost, for a start from another problem's solution."""
NEAR_BARRIER = 1e-5
"""Barrier parameter in segments between jumps, which begin without multipliers."""

Meshes = tuple[Mesh, ...]
"""Mesh of each phase."""

RELAXED = 150
"""Maximum number of iterations of the elastic program."""
AIMLESS = (
    "a motion that meets all constraints was found, but no best one; try further first guesses "
    "(`starts: 5`), other `intervals`, or a weight on `joint_acceleration`"
)
"""Message where the search from a feasible motion ends without a solution."""
FEASIBLE = 1e-7
"""Violation of the elastic program's solution that counts as none."""
MOST_SEGMENTS = 40
"""Number of segments between jumps from which only the mesh is refined."""
GAIN = 1e-3
"""Minimum relative gain in cost for another refinement at the jumps of forces."""
DRAWN = 2
"""Maximum number of drawn guesses for leaving a saddle point."""

ROUNDS, ROOM = 4, 1.5
"""Maximum number of searches on the same mesh with more room to limits that are passed between its points,
and the room over that excess. Where an arrival is given, the plan need not be the cheapest."""

MANY, COARSER = 16, 4
"""Intervals from which on a first mesh is solved from one that is coarser by a factor, where iterations cost
less and links that collide are found."""
STALL = "Stalled"
STALLED_AT, STALLED = 20, 0.25
"""A search whose violation is above this share of its guess's after so many iterations is given up
for one on a coarser mesh; searches that converge soon have reduced it further by then."""


def solve_request(solver: PlanSolver, request: SolveRequest) -> SolveResult:
    """Search for a motion.

    Args:
        solver: The problem.
        request: Request that is answered.
    """
    near = request.near
    run = _SolverRuns(solver if near is None else solver.keeping_apart(near.apart), request)
    if near is not None and request.is_solved:
        run.cost, run.cause = near.cost, near.cause
        run.kept, run.cleared = None if near.solution is None else (near.solution, near.meshes), near.solution
    else:
        run.solve(near)
        run.clear()
    verification = run.refined() if request.refine and run.kept is not None else None
    solution, meshes = run.kept or (None, solver.meshes(solver.plan.intervals))
    return SolveResult(tuple(run.runs), solution, meshes, run.cost, verification, run.cause, run.solver.apart)


NOTHING = 1e-12
"""Cost that counts as none."""
WORSE = 1e-5
"""Relative difference in cost from which one mesh's plan is worse than another's; discretisation errors of
plans that pass the verification are smaller."""


@dataclass(frozen=True)
class VerifiedPlan:
    """Solution that passed the verification.

    Attributes:
        solver: The problem, with the keep-out zones that it was solved with.
        kept, cost: The solution with the mesh of each phase, and its cost.
        verification: Its verification.
    """

    solver: PlanSolver
    kept: tuple[Solution, Meshes]
    cost: float
    verification: VerificationResult


def _size(cost: float) -> float:
    """Scale of residuals: the cost, or one where the cost vanishes."""
    return cost if cost > NOTHING else 1.0


class _SolverRuns:
    """Runs of the solver, one after the other."""

    def __init__(self, solver: PlanSolver, request: SolveRequest) -> None:
        self.solver, self.request = solver, request
        self.runs: list[SolverRun] = []
        self.kept: tuple[Solution, Meshes] | None = None
        self.cleared: Solution | None = None
        self.cost, self.cause, self.why = np.inf, "", ""
        self.deadline = time.thread_time() + solver.plan.time_limit
        self.ended: tuple[PhaseChain, Solution, Meshes] | None = None
        self.stalled = False
        self.best: VerifiedPlan | None = None
        self.margins: dict[str, float] = {}

    @property
    def problem(self) -> PlanningProblem:
        """The problem of the first phase, as it is asked."""
        return self.solver.problem_of(self.request)

    def solve(self, near: SolveResult | None) -> None:
        """Solve from a motion nearby if there is one, else or where that fails from a first guess."""
        if near is not None and near.solution is not None and len(near.meshes) == len(self.solver.phases):
            self.warm(near)
        if self.kept is None:
            self.cold()
        if self.kept is None and self.request.explain:
            self.relaxed()

    def clear(self, *, only_warm: bool = False) -> None:
        """Solve again with keep-out zones for links that collide along what is kept, until none do.

        Most pairs never come near, so that a pair has a constraint only where a motion violates it. What was
        found before is begun with, its multipliers too. With ``only_warm`` nothing else is tried.
        """
        while self.kept is not None and self.kept[0] is not self.cleared:
            (solution, meshes), solver = self.kept, self.solver
            current = SolveResult((), solution, meshes, self.cost, None, "", solver.apart)
            entered = course_collisions(
                solver.phased_motion(self.request, current), solver.pairs, between=True
            )
            self.solver = solver.keeping_apart(entered)
            if self.solver is solver:
                self.cleared = solution
                return
            solver.notify(f"planning again: {entered[0].words()}")
            self.kept, self.cost = None, np.inf
            near = None
            if len(meshes) == len(solver.phases):  # else forces jump: from a first guess
                programs = (each.program(self.request, meshes) for each in (solver, self.solver))
                near = dataclasses.replace(
                    current, solution=transfer_constrained(solution, *programs), apart=self.solver.apart
                )
            if only_warm and near is not None:
                self.warm(near)
            else:
                self.solve(near)

    def cold(self) -> None:
        """Solve from a first guess, on the first mesh, and before on a coarser one where that is fine."""
        many = self.solver.plan.intervals
        meshes = self.solver.meshes(many)
        if is_guided(self.problem):  # by an approach, which a coarse mesh of a tumbling target would lose
            self._guessed(meshes)
        elif many < MANY:
            coarser = many // COARSER
            solved = self._guessed(meshes, give_up=coarser > 1)
            if self.stalled and not solved:
                solved = self._guessed(self.solver.meshes(coarser)) and self._finer(meshes)
                if not solved:
                    self.kept, self.cost = None, np.inf
                    self._guessed(meshes)
        else:
            if self._guessed(self.solver.meshes(many // COARSER)):
                self.clear(only_warm=True)  # until no links collide on the coarse mesh
            if self.kept is None or not self._finer(meshes):
                self.kept, self.cost = None, np.inf
                self._guessed(meshes)
        # From a symmetric guess, as a turn about its eigenaxis, IPOPT's steps are symmetric too and may end
        # at a saddle point: search from drawn guesses then, and keep what costs less.
        for k in range(1, DRAWN + 1):
            if self.kept is None:
                return
            best, cost = self.kept, self.cost
            if descent_direction(self.solver.program(self.request, best[1]), best[0], _size(cost)) is None:
                return
            if (
                not self._guessed(best[1], self.request.start + k * self.solver.plan.starts)
                or self.cost >= cost
            ):
                self.kept, self.cost, self.cause = best, cost, ""

    def warm(self, near: SolveResult) -> None:
        """Solve from the solution of a problem with another duration or other weights, on its mesh."""
        assert near.solution is not None
        phased_motion, (least, greatest, _) = (
            self.solver.phased_motion(self.request, near),
            self.problem.duration,
        )
        motion, *others = phased_motion.motions
        duration = float(np.clip(motion.duration_s, least, greatest))
        phased_motion = dataclasses.replace(
            phased_motion, motions=(rescaled_motion(motion, self.problem, duration), *others)
        )
        solution = dataclasses.replace(near.solution, barrier=max(near.solution.barrier, BARRIER))
        self._solve(phased_motion, near.meshes, solution)

    def refined(self) -> VerificationResult | None:
        """Verification of what is kept after refinement: the best plan that passes, where one does."""
        verification, best = self._refine(), self.best
        if best is None:
            return verification
        is_worse = self.cost - best.cost > WORSE * _size(best.cost)
        if self.kept is None or verification is None or verification.failures() or is_worse:
            self.solver, self.kept, self.cost, self.cause = best.solver, best.kept, best.cost, ""
            return best.verification
        return verification

    def _refine(self) -> VerificationResult | None:
        """Verification of the motion, its mesh refined until it passes or the finest mesh is reached."""
        # A motion can be cut where nothing holds for a part of its duration, and its start is given. Where
        # magnitudes are a cost, drives are linear and meshes are sharpened instead.
        problem = self.problem
        jumps = self.solver.names == ("",) and problem.begin is None and not problem.magnitudes
        jumps = jumps and all(row.final_fraction == 1.0 for row in problem.path)
        verification, before = None, np.inf
        span = self.solver.plan.duration
        is_arrival = span is not None and span.arrivals > 0  # the first plan that is verified is wanted
        rounds = ROUNDS if is_arrival else 0
        while True:
            self.clear()
            if self.kept is None:
                return verification
            (solution, meshes), solver = self.kept, self.solver
            phased_motion = solver.phased_motion(
                self.request, SolveResult((), solution, meshes, self.cost, None, "")
            )
            solver.notify("replaying the plan")
            program = solver.interpreted.program(self.request, meshes, self.margins)
            verification = verify(phased_motion, program, solution, _size(self.cost), solver.backend)
            if not verification.failures() and (self.best is None or self.cost < self.best.cost):
                self.best = VerifiedPlan(solver, self.kept, self.cost, verification)
            if verification.fine_enough:
                if is_arrival:
                    return verification
                sharper = sharper_meshes(phased_motion, solver.plan.max_intervals)
                gained, before = before - self.cost, self.cost
                if sharper is None or gained < GAIN * self.cost:
                    return verification
                self.why = " (refined, for forces that jump)"
                if not self._finer(sharper):
                    self.cause = ""
                    return verification
                continue
            if rounds and verification.error_m <= verification.tolerance_m:
                rounds -= 1
                if self._with_room(verification):
                    continue
            if jumps and len(meshes) < MOST_SEGMENTS:
                pieces = split_at_jumps(phased_motion, self.problem)
                jumps = pieces is not None and self._segmented(pieces)
                if jumps:
                    continue
                self.cause = ""
            finer = refined_meshes(phased_motion, verification, solver.plan.max_intervals, solver.backend)
            if finer is None:
                self.cause = f"no finer mesh is allowed: raise `max_intervals`, {solver.plan.max_intervals}"
                return verification
            self.why = f" (refined, for {verification.failures()[-1]})"
            if not self._finer(finer):
                return verification

    def _with_room(self, verification: VerificationResult) -> bool:
        """Solve on the same mesh with more room to the limits that are passed between its points."""
        assert self.kept is not None
        (solution, meshes), kept, cost, margins = self.kept, self.kept, self.cost, dict(self.margins)
        for one in verification.exceeded:
            self.margins[one.name] = self.margins.get(one.name, 0.0) + ROOM * one.amount
        self.why = f" (more room, for {verification.failures()[-1]})"
        near = SolveResult((), solution, meshes, self.cost, None, "")
        phased_motion = self.solver.phased_motion(self.request, near)
        warm = dataclasses.replace(solution, barrier=max(solution.barrier, BARRIER))
        if self._solve(phased_motion, meshes, warm):
            return True
        self.kept, self.cost, self.margins = kept, cost, margins
        return False

    def relaxed(self) -> None:
        """Solve the elastic program where the search ended by itself without a solution.

        A feasible point is the next first guess; otherwise the multipliers state which limits prevent one.
        """
        if self.ended is None:
            return
        program, solution, meshes = self.ended
        w = solution.w if np.isfinite(solution.w).all() else self._first
        elastic = ElasticProgram(program, soft_rows(program), _size(program.objective(w)))
        self.solver.notify("looking for the least violation")
        relaxation = solve(
            elastic,
            elastic.started(w),
            iterations=min(self.solver.plan.iterations, RELAXED),
            on_iteration=lambda k, cost, _: self._late(f"least violation: iteration {k}, {cost:.3g}"),
        )
        unknowns = relaxation.w[: program.size]
        if elastic.violation(relaxation.w) < FEASIBLE and relaxation.converged:
            near = SolveResult((), dataclasses.replace(solution, w=unknowns), meshes, 0.0, None, "")
            if not self._solve(self.solver.phased_motion(self.request, near), meshes):
                self.cause = self.cause or AIMLESS
        elif relaxation.converged or not self.cause:
            self.cause = infeasibility_message(program, elastic, relaxation, solution.status)

    def _late(self, words: str) -> bool:
        """Tell what is being done; whether the time is over, so that no further iteration begins."""
        self.solver.notify(words)
        return time.thread_time() > self.deadline

    def _guessed(self, meshes: Meshes, start: int | None = None, *, give_up: bool = False) -> bool:
        """Solve from a first guess on a mesh, that of the search's start if none is named.

        With ``give_up`` the solver is stopped where it stalls.
        """
        start = self.request.start if start is None else start
        rng = np.random.default_rng([self.solver.plan.seed, start]) if start else None
        solver = self.solver
        motions = list[Motion]()
        for problem, mesh in zip(solver.problems_of(self.request), meshes, strict=True):
            if motions:  # from where the phase before it ends
                end = np.concatenate([motions[-1].q[-1], motions[-1].v[-1]])
                begin = state_after_impact(problem.stage, end, locked=True)
                problem = dataclasses.replace(problem, fixed=begin)
            motions.append(initial_guess(problem, solver.lobatto, mesh, rng, start))
        impulses = tuple(np.zeros(link.impulses) for link in solver.links)
        return self._solve(PhasedMotion(tuple(motions), impulses), meshes, give_up=give_up)

    def _finer(self, wanted: Meshes) -> bool:
        """Solve on a finer mesh from what is kept."""
        assert self.kept is not None
        solver, (solution, meshes) = self.solver, self.kept
        coarse, fine = (solver.program(self.request, each) for each in (meshes, wanted))
        phased_motion = solver.phased_motion(
            self.request, SolveResult((), solution, meshes, self.cost, None, "")
        )
        finer = phased_motion.on(solver.lobatto, wanted)
        if len(wanted) > len(solver.phases):
            return self._segmented(finer)
        return self._solve(finer, wanted, transfer(solution, coarse, fine))

    def _segmented(self, pieces: PhasedMotion) -> bool:
        """Solve in segments, near the kept motion.

        Its multipliers do not fit new segments or new linear drives. With a large barrier parameter the
        search leaves the neighbourhood, and often ends at a worse optimum after many more iterations.
        """
        assert self.kept is not None
        none = np.empty(0)
        near = dataclasses.replace(
            self.kept[0], multipliers=none, bound_multipliers=none, barrier=NEAR_BARRIER
        )
        return self._solve(pieces, pieces.meshes, near)

    def _solve(
        self,
        phased_motion: PhasedMotion,
        meshes: Meshes,
        warm: Solution | None = None,
        *,
        give_up: bool = False,
    ) -> bool:
        solver, costs, violations = self.solver, list[float](), list[float]()
        program = solver.program(self.request, meshes, self.margins)
        intervals = sum(mesh.intervals for mesh in meshes)
        many = f"start {self.request.start + 1} of {solver.plan.starts}, " if solver.plan.starts > 1 else ""
        words = f"solving: {many}{intervals} intervals{self.why}"

        def on_iteration(iteration: int, cost: float, violation: float) -> bool:
            """Record an iteration, and report it."""
            costs.append(cost)
            violations.append(violation)
            late = self._late(f"{words}, iteration {iteration}, cost {cost:.4g}, violation {violation:.1e}")
            self.stalled = give_up and len(violations) == STALLED_AT and violation > STALLED * violations[0]
            return late or self.stalled

        first = self._first = phased_motion.unknowns
        self.ended, fault = None, bad_guess_message(program, first)
        if fault is not None:
            self.cause = fault
            return False
        guessed = program.objective(first)
        scale = _size(self.cost if np.isfinite(self.cost) else guessed)
        solution = solve(
            program, first, warm, scale=scale, iterations=solver.plan.iterations, on_iteration=on_iteration
        )
        cost, converged = program.objective(solution.w), solution.converged
        self.runs.append(
            SolverRun(
                self.request.start,
                intervals,
                cost,
                STALL if self.stalled else solution.status,
                converged,
                solution.iterations,
                solution.evaluations_s,
                solution.seconds,
                tuple(costs),
                tuple(violations),
            )
        )
        if converged:
            self.kept, self.cost, self.cause = (solution, meshes), cost, ""
        else:
            self.cause = limit_message(program, solution, solver.plan)
            self.ended = None if solution.status == TIME_LIMIT else (program, solution, meshes)
        return converged
