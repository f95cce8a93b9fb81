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
from optim.planning.search.held_joints import motion_with_joints, solver_with_joints_held
from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult, SolverRun
from optim.planning.solver.elastic import ElasticProgram
from optim.planning.solver.ipopt import PATIENCE, TIME_LIMIT, Solution, solve
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
WARM_BARRIER, SHORT = 1e-2, PATIENCE
"""Barrier parameter relative to the cost, and maximum number of iterations, of a search that starts from the
solution without the distances of shapes."""
NEAR_BARRIER = 1e-5
"""Barrier parameter in segments between jumps, which start without multipliers."""

Meshes = tuple[Mesh, ...]
"""Mesh of each phase."""

RELAXED = 150
"""Maximum number of iterations of the elastic program."""
AIMLESS = (
    "a motion that meets all constraints was found, but no best one; try further first guesses "
    "(`starts: 5`), other `intervals`, or a weight on `joint_acceleration`"
)
"""Message of a search from a feasible motion that ends without a solution."""
FEASIBLE = 1e-7
"""Violation of the elastic program's solution below which it is feasible."""
MOST_SEGMENTS = 40
"""Number of segments between jumps from which only the mesh is refined."""
GAIN = 1e-3
"""Minimum relative gain in cost for another refinement at the jumps of forces."""
DRAWN = 2
"""Maximum number of random guesses for leaving a saddle point."""

ROUNDS, ROOM = 4, 1.5
"""Maximum number of searches on the same mesh with more room to limits that are passed between its points,
and the room over that excess. Where an arrival is given, the plan need not be the cheapest."""

MANY, COARSER = 16, 4
"""Intervals from which on a first mesh is solved from one that is coarser by a factor, where iterations cost
less and links that collide are found."""
STALL = "Stalled"
STALLED_AT, STALLED = 20, 0.25
"""Number of iterations after which a search on the first mesh, if that has fewer than :data:`MANY` intervals,
is abandoned for one on a coarser mesh if its violation exceeds this share of its guess's; converging searches
have reduced it further by then."""


def solve_request(solver: PlanSolver, request: SolveRequest) -> SolveResult:
    """Solve a request: search, refine and verify a motion.

    Args:
        solver: The problem.
        request: Request with duration, weights and initial guess.
    """
    near = request.near
    run = _SolverRuns(solver if near is None else solver.keeping_apart(near.apart), request)
    if near is not None and request.is_solved:
        run.cost, run.cause = near.cost, near.cause
        run.optimum = None if near.solution is None else (near.solution, near.meshes)
        run.cleared = near.solution
    else:
        run.solve(near)
        run.clear()
    verification = run.refined() if request.refine and run.optimum is not None else None
    solution, meshes = run.optimum or (None, solver.meshes(solver.plan.intervals))
    return SolveResult(tuple(run.runs), solution, meshes, run.cost, verification, run.cause, run.solver.apart)


NOTHING = 1e-12
"""Cost below which it counts as zero."""
WORSE = 1e-5
"""Relative difference in cost above which one mesh's plan is worse than another's; discretisation errors of
verified plans are smaller."""


@dataclass(frozen=True)
class VerifiedPlan:
    """Solution that passed the verification.

    Attributes:
        solver: The problem, with the keep-out zones used in the solve.
        optimum, cost: Solution with the mesh of each phase, and its cost.
        verification: Its verification.
    """

    solver: PlanSolver
    optimum: tuple[Solution, Meshes]
    cost: float
    verification: VerificationResult


def _size(cost: float) -> float:
    """Scale of residuals: the cost, or one if the cost vanishes."""
    return cost if cost > NOTHING else 1.0


class _SolverRuns:
    """Runs of the solver for one request, in order, with the best solution so far."""

    def __init__(self, solver: PlanSolver, request: SolveRequest) -> None:
        self.solver, self.request = solver, request
        self.runs: list[SolverRun] = []
        self.optimum: tuple[Solution, Meshes] | None = None
        self.cleared: Solution | None = None
        self.cost, self.cause, self.why = np.inf, "", ""
        self.deadline = time.thread_time() + solver.plan.time_limit
        self.ended: tuple[PhaseChain, Solution, Meshes] | None = None
        self.stalled = False
        self.best: VerifiedPlan | None = None
        self.margins: dict[str, float] = {}

    @property
    def problem(self) -> PlanningProblem:
        """Problem of the first phase, with the request's duration and weights."""
        return self.solver.problem_of(self.request)

    def solve(self, near: SolveResult | None) -> None:
        """Solve from a nearby motion if there is one; if that fails, from an initial guess."""
        if near is not None and near.solution is not None and len(near.meshes) == len(self.solver.phases):
            self.warm(near)
        if self.optimum is None:
            self.cold()
        if self.optimum is None and self.request.explain:
            self.relaxed()

    def clear(self, *, only_warm: bool = False) -> None:
        """Add keep-out zones for links that collide along the present solution; solve until none collide.

        Most pairs of links never come near each other, so a pair gets a constraint only after a collision.
        Each solve is warm-started by the previous solution and its multipliers, except in segments between
        jumps of forces. With ``only_warm`` no cold start is tried after a warm one.
        """
        while self.optimum is not None and self.optimum[0] is not self.cleared:
            (solution, meshes), solver = self.optimum, self.solver
            current = SolveResult((), solution, meshes, self.cost, None, "", solver.apart)
            entered = course_collisions(
                solver.phased_motion(self.request, current), solver.pairs, between=True
            )
            self.solver = solver.keeping_apart(entered)
            if self.solver is solver:
                self.cleared = solution
                return
            solver.notify(f"planning again: {entered[0].words()}")
            self.optimum, self.cost = None, np.inf
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
        """Solve from an initial guess on the first mesh; if that mesh is fine, on a coarser one first."""
        many = self.solver.plan.intervals
        meshes = self.solver.meshes(many)
        if is_guided(self.problem):  # by an approach, which a coarse mesh of a tumbling target would lose
            if not (self._with_joints_held() or self._around_shapes(meshes)):
                self._guessed(meshes)
        elif many < MANY:
            coarser = many // COARSER
            solved = self._guessed(meshes, give_up=coarser > 1)
            if self.stalled and not solved:
                solved = self._guessed(self.solver.meshes(coarser)) and self._finer(meshes)
                if not solved:
                    self.optimum, self.cost = None, np.inf
                    self._guessed(meshes)
        else:
            if self._guessed(self.solver.meshes(many // COARSER)):
                self.clear(only_warm=True)  # until no links collide on the coarse mesh
            if self.optimum is None or not self._finer(meshes):
                self.optimum, self.cost = None, np.inf
                self._guessed(meshes)
        # A symmetric guess, such as a rotation about the eigenaxis, makes IPOPT's steps symmetric too, so
        # that it may end at a saddle point. In that case search from random guesses, and take the cheaper
        # result.
        for k in range(1, DRAWN + 1):
            if self.optimum is None:
                return
            best, cost = self.optimum, self.cost
            if descent_direction(self.solver.program(self.request, best[1]), best[0], _size(cost)) is None:
                return
            if (
                not self._guessed(best[1], self.request.start + k * self.solver.plan.starts)
                or self.cost >= cost
            ):
                self.optimum, self.cost, self.cause = best, cost, ""

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
        """Refine, and return the verification of the cheapest plan that passes; the last one if none does."""
        verification, best = self._refine(), self.best
        if best is None:
            return verification
        is_worse = self.cost - best.cost > WORSE * _size(best.cost)
        if self.optimum is None or verification is None or verification.failures() or is_worse:
            self.solver, self.optimum, self.cost, self.cause = best.solver, best.optimum, best.cost, ""
            return best.verification
        return verification

    def _refine(self) -> VerificationResult | None:
        """Refine the mesh until the motion passes or the finest mesh is reached; returns the verification."""
        # A motion can be segmented if no constraint is limited to a part of its duration and its start is
        # fixed. If magnitudes are a cost, drives are linear and meshes are refined at their changes instead.
        problem = self.problem
        jumps = self.solver.names == ("",) and problem.begin is None and not problem.magnitudes
        jumps = jumps and all(row.final_fraction == 1.0 for row in problem.path)
        verification, before = None, np.inf
        span = self.solver.plan.duration
        is_arrival = span is not None and span.arrivals > 0  # the first plan that is verified is wanted
        rounds = ROUNDS if is_arrival else 0
        while True:
            self.clear()
            if self.optimum is None:
                return verification
            (solution, meshes), solver = self.optimum, self.solver
            phased_motion = solver.phased_motion(
                self.request, SolveResult((), solution, meshes, self.cost, None, "")
            )
            solver.notify("replaying the plan")
            program = solver.interpreted.program(self.request, meshes, self.margins)
            verification = verify(phased_motion, program, solution, _size(self.cost), solver.backend)
            if not verification.failures() and (self.best is None or self.cost < self.best.cost):
                self.best = VerifiedPlan(solver, self.optimum, self.cost, verification)
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
        assert self.optimum is not None
        (solution, meshes), optimum, cost, margins = self.optimum, self.optimum, self.cost, dict(self.margins)
        for one in verification.exceeded:
            self.margins[one.name] = self.margins.get(one.name, 0.0) + ROOM * one.amount
        self.why = f" (larger margins, for {verification.failures()[-1]})"
        near = SolveResult((), solution, meshes, self.cost, None, "")
        phased_motion = self.solver.phased_motion(self.request, near)
        warm = dataclasses.replace(solution, barrier=max(solution.barrier, BARRIER))
        if self._solve(phased_motion, meshes, warm):
            return True
        self.optimum, self.cost, self.margins = optimum, cost, margins
        return False

    def relaxed(self) -> None:
        """Solve the elastic program if the search ended on its own without a solution.

        A feasible point is the next initial guess; otherwise the multipliers identify the limiting
        constraints.
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
        """Report a step; returns whether the time limit has passed, so that no further iteration begins."""
        self.solver.notify(words)
        return time.thread_time() > self.deadline

    def _guessed(self, meshes: Meshes, start: int | None = None, *, give_up: bool = False) -> bool:
        """Solve from an initial guess on the given meshes: that of ``start``, or the request's if None.

        With ``give_up`` the solver is stopped if it stalls; see :data:`STALLED`.
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

    def _with_joints_held(self) -> bool:
        """Solve with the joints held, and then with moving joints from that solution."""
        held = solver_with_joints_held(self.solver)
        if held is None or self.request.start:
            return False
        request = dataclasses.replace(
            held.request(), duration=self.request.duration, refine=False, explain=False
        )
        result = solve_request(held, request)
        self.runs.extend(result.runs)
        if result.solution is None:
            return False
        (motion,) = held.phased_motion(request, result).motions
        self.deadline = time.thread_time() + self.solver.plan.time_limit
        return self._solve(PhasedMotion((motion_with_joints(self.problem, motion),)), result.meshes)

    def _around_shapes(self, meshes: Meshes) -> bool:
        """Solve without the distances of shapes, then with them from that solution.

        The gradient of a distance jumps where another face comes nearest, so that a search from a guess that
        passes through a shape often diverges; the solution without distances is mostly clear of them or
        nearly so. The second search is abandoned early, because it may start deep inside a shape.
        """
        shapes = [row.name for row in self.problem.path if row.about is not None]
        if not shapes:
            return False
        self.margins = dict.fromkeys(shapes, -np.inf)
        is_solved = self._guessed(meshes)
        self.margins = {}
        if not is_solved:
            return False
        assert self.optimum is not None
        solution, cost = self.optimum[0], self.cost
        near = SolveResult((), solution, meshes, cost, None, "")
        self.optimum, self.cost = None, np.inf
        warm = dataclasses.replace(solution, barrier=max(solution.barrier, WARM_BARRIER))
        return self._solve(self.solver.phased_motion(self.request, near), meshes, warm, iterations=SHORT)

    def _finer(self, finer_meshes: Meshes) -> bool:
        """Solve on a finer mesh from the present solution."""
        assert self.optimum is not None
        solver, (solution, meshes) = self.solver, self.optimum
        coarse, fine = (solver.program(self.request, each) for each in (meshes, finer_meshes))
        phased_motion = solver.phased_motion(
            self.request, SolveResult((), solution, meshes, self.cost, None, "")
        )
        finer = phased_motion.on(solver.lobatto, finer_meshes)
        if len(finer_meshes) > len(solver.phases):
            return self._segmented(finer)
        return self._solve(finer, finer_meshes, transfer(solution, coarse, fine))

    def _segmented(self, pieces: PhasedMotion) -> bool:
        """Solve in segments between drive jumps, near the present solution.

        Its multipliers fit neither new segments nor new linear drives. With a large barrier parameter the
        search leaves the neighbourhood, and often ends at a worse optimum after many more iterations.
        """
        assert self.optimum is not None
        none = np.empty(0)
        near = dataclasses.replace(
            self.optimum[0], multipliers=none, bound_multipliers=none, barrier=NEAR_BARRIER
        )
        return self._solve(pieces, pieces.meshes, near)

    def _solve(
        self,
        phased_motion: PhasedMotion,
        meshes: Meshes,
        warm: Solution | None = None,
        *,
        give_up: bool = False,
        iterations: int | None = None,
    ) -> bool:
        solver, costs, violations = self.solver, list[float](), list[float]()
        program = solver.program(self.request, meshes, self.margins)
        intervals = sum(mesh.intervals for mesh in meshes)
        many = f"start {self.request.start + 1} of {solver.plan.starts}, " if solver.plan.starts > 1 else ""
        words = f"solving: {many}{intervals} intervals{self.why}"

        def on_iteration(iteration: int, cost: float, violation: float) -> bool:
            """Record an iteration, and report it; returns whether to stop."""
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
        iterations = min(solver.plan.iterations, iterations or solver.plan.iterations)
        solution = solve(program, first, warm, scale=scale, iterations=iterations, on_iteration=on_iteration)
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
            self.optimum, self.cost, self.cause = (solution, meshes), cost, ""
        else:
            self.cause = limit_message(program, solution, solver.plan)
            self.ended = None if solution.status == TIME_LIMIT else (program, solution, meshes)
        return converged
