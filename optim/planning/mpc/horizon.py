"""Repeated planning over a horizon: the remaining duration of the first plan, then a constant horizon.

Intervals keep their length as far as the start times of the plans allow. The rest of one plan then lies on
the mesh of the next, so that its unknowns and multipliers are a warm start and a few iterations suffice.
After the end of the first plan each plan holds the goal for a short horizon from its own start.

In a plan with several phases only the first phase shrinks; every solve includes the following phases in full,
so that the state at the end of the first phase suits them. There is no replanning after its end.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import gc
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.reaction_wheels import commanded_base_wrench
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.search.make_plan import failure_message
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.search.solve_request import solve_request
from optim.planning.solver.ipopt import PATIENCE, Solution, solve
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.mesh_transfer import transfer_constrained, transfer_remaining
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.transcription.phase_chain import PhaseChain
from optim.planning.verification.replay import joint_angle
from optim.planning.verification.verify import course_collisions
from spacerobot.common.arrays import Array
from spacerobot.common.errors import NoPlanError

FEWEST = 4
"""Minimum number of intervals of a replanned motion (or the first plan's number, if that is smaller)."""
ROUNDING = 1e-9
"""Tolerance of the number of intervals, and of times relative to a plan's duration."""
TOLERANCE = 1e-5
"""Largest residual of the first-order conditions of a replan, which is flown for one period. The replans of a
soft capture take 5.8 iterations in the mean, 7.2 to the 1e-8 of a whole plan, and both flights end at the
same distance from the port to 0.1 mm."""
GOOD = 1e-4
"""Maximum violation [m, rad, N or N m] at which an unconverged plan is used."""
ROOM = 1e-6
"""Margin beyond the measured value to which a limit that it violates is widened [m, rad, N or N m]."""


@contextlib.contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Context in which Python looks for no cyclic garbage, which takes 70 ms with the objects of a scene."""
    is_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_enabled:
            gc.enable()


@dataclass
class Horizon:
    """The present plan, and the record of all solves.

    Attributes:
        solver: Solver of the planning problem.
        motion, solution, program: The present plan, its solution, and the program that it solves.
        first_duration_s: Duration of the first plan [s].
        begin_s: Time at which the present plan began, since the first one began [s].
        min_horizon: Minimum planning horizon [s].
        iterations, seconds: Number of iterations, and time [s], of each solve.
        missed, unfinished: Number of solves without a plan, and of plans used before the solver converged.
    """

    solver: PlanSolver
    motion: Motion
    solution: Solution
    program: PhaseChain
    first_duration_s: float
    min_horizon: float
    begin_s: float = 0.0
    iterations: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    missed: int = 0
    unfinished: int = 0

    @classmethod
    def of(
        cls, solver: PlanSolver, measured: Array, min_horizon: float, inertia: Array | None = None
    ) -> Horizon:
        """Make the first plan, from an initial guess.

        Args:
            solver: Solver of the planning problem.
            measured: Estimated configuration and velocity at the start (nq + nv,).
            min_horizon: Minimum planning horizon [s].
            inertia: Estimated inertial parameters of the target (10,); those of the model if None.

        Raises:
            NoPlanError: If no plan is found.
        """
        problem = with_inertia(dataclasses.replace(solver.problem, fixed=measured), inertia)
        phase_solver = solver.with_first(problem=problem)
        request = phase_solver.request(refine=False)
        result = solve_request(phase_solver, request)
        if result.solution is None:
            raise NoPlanError(str(failure_message(result)), source=solver.scene.source, where="plan")
        motion, solver = phase_solver.motion(request, result), solver.keeping_apart(result.apart)
        program: PhaseChain = phase_solver.keeping_apart(result.apart).program(request, result.meshes)
        return cls(
            solver,
            motion,
            result.solution,
            program,
            motion.duration_s,
            min_horizon,
            iterations=[one.iterations for one in result.runs],
            seconds=[one.seconds for one in result.runs],
        )

    @without_garbage_collection()
    def replan(self, begin: float, measured: Array, iterations: int, inertia: Array | None = None) -> None:
        """Replan from a given time: warm-started by the present plan, then from an initial guess.

        If no solve gives a usable plan without collisions, the present plan is kept.

        Args:
            begin: Time at which the plan begins, since the first one began [s].
            measured: Estimated configuration and velocity at that time (nq + nv,).
            iterations: Maximum number of iterations.
            inertia: Estimated inertial parameters of the target (10,); the previous ones if None.
        """
        clock, scale = time.perf_counter(), self.solution.scale
        measured = continued(self.solver.scene.model, measured, self.at(np.array([begin]))[0][0])
        solver = self.solver.with_first(problem=with_inertia(self.solver.problem, inertia))
        problem = self._problem(solver, begin, measured)
        duration, full_intervals = problem.duration[0], self.solver.plan.intervals
        intervals = max(
            min(full_intervals, FEWEST),
            int(np.ceil(full_intervals * duration / self.first_duration_s - ROUNDING)),
        )
        program = self._program(solver, problem, intervals)
        later = self.program.parts(self.solution.w)[1:]
        # share of the present plan that has passed when the next one begins, if both end together
        gone = (
            (begin - self.begin_s) / self.motion.duration_s
            if begin < self.first_duration_s * (1 - ROUNDING)
            else 0.0
        )
        # multipliers of the present solution for a program whose first phase begins later
        parts = self.program.parted(self.solution)
        parts[0] = transfer_remaining(parts[0], self.program.programs[0], program.programs[0], gone)
        warm = dataclasses.replace(
            self.solution,
            multipliers=np.concatenate(
                [*(part.multipliers for part in parts), np.zeros(len(program.rest.least))]
            ),
            bound_multipliers=np.concatenate([part.bound_multipliers for part in parts]),
        )
        # unknowns of the remaining plan, extended by a uniform motion after its end
        first, model = program.programs[0], problem.stage.scene.model
        end = self.begin_s + self.motion.duration_s
        times = begin + first.lobatto.times(first.mesh, duration)
        q, v, a, u, w = self.at(np.minimum(times, end))
        for k, late in enumerate(times - end):
            if late > ROUNDING * duration:
                q[k], a[k], u[k] = pin.integrate(model, q[k], v[k] * late), 0.0, 0.0
        z = np.hstack([q, v, a, u, w, np.zeros((len(q), problem.stage.s.numel()))])
        z[0, : first.nx] = measured
        ahead = Motion(problem, solver.lobatto, first.mesh, duration, z).split_forces().unknowns
        ahead = np.concatenate([ahead, *later])
        candidate = solve(program, ahead, warm, iterations=min(iterations, PATIENCE))
        spent = candidate.iterations
        if not is_usable(program, candidate) and spent < iterations:
            fresh = initial_guess(problem, solver.lobatto, intervals).unknowns
            fresh = np.concatenate([fresh, *later])
            remaining_iterations = iterations - spent
            candidate = solve(program, fresh, scale=scale, iterations=remaining_iterations)
            spent += candidate.iterations
        while is_usable(program, candidate):
            collocation = program.programs[0]
            z, duration = collocation.split(candidate.w[: collocation.size])
            motion = Motion(problem, solver.lobatto, collocation.mesh, duration, z)
            wider = solver.keeping_apart(course_collisions(PhasedMotion((motion,)), solver.pairs))
            if wider is solver:
                self.solver, self.motion = solver, motion
                self.solution, self.program, self.begin_s = candidate, program, begin
                self.unfinished += not candidate.converged
                break
            # links collide: solve once more from here, with the keep-out zones that this plan needs
            problem, before, solver = self._problem(wider, begin, measured), program, wider
            program = self._program(solver, problem, intervals)
            warm = transfer_constrained(candidate, before, program)
            remaining_iterations = min(max(iterations - spent, 1), PATIENCE)
            candidate = solve(program, candidate.w, warm, scale=scale, iterations=remaining_iterations)
            spent += candidate.iterations
        else:
            self.missed += 1
        self.iterations.append(spent)
        self.seconds.append(time.perf_counter() - clock)

    def _program(self, solver: PlanSolver, problem: PlanningProblem, intervals: int) -> PhaseChain:
        """Program of the remaining first phase and of the phases that follow."""
        meshes = Mesh.of(intervals), *(old.mesh for old in self.program.programs[1:])
        request = solver.request(duration=problem.duration, weights=problem.weights)
        program = solver.with_first(problem=problem).program(request, meshes)
        program.tolerance = TOLERANCE
        return program

    def _problem(self, solver: PlanSolver, begin: float, measured: Array) -> PlanningProblem:
        """Planning problem from a given time on.

        A constraint on the last part of the plan keeps its start time, and is dropped once the first
        plan has ended. Limits on the whole motion that are violated already are widened.
        """
        problem, left = solver.problem, self.first_duration_s - begin
        behind = left < ROUNDING * self.first_duration_s
        duration = self.min_horizon if behind else left
        z = self._instants(np.array([begin]))[0]
        z[: measured.size] = measured
        values = solver.instants.call("values", problem.arguments(z[None, :]))[measured.size :, 0]
        rows = []
        for row, value in zip(problem.path, values, strict=False):
            if behind and row.final_fraction < 1:
                rows.append(dataclasses.replace(row, lower=-np.inf, upper=np.inf))
                continue
            last = min(row.final_fraction * self.first_duration_s / duration, 1.0)
            low, high = row.lower, row.upper
            if last == 1:
                low = low if value >= low else value - ROOM
                high = high if value <= high else value + ROOM
            rows.append(dataclasses.replace(row, final_fraction=last, lower=low, upper=high))
        return dataclasses.replace(problem, path=tuple(rows), fixed=measured, duration=(duration,) * 3)

    @property
    def statistics(self) -> dict[str, Any]:
        """Numbers of solves (``plans``), missed and unfinished ones; iterations and time [s] of each."""
        keys = ("missed", "unfinished", "iterations", "seconds")
        return {"plans": len(self.seconds)} | {key: getattr(self, key) for key in keys}

    def at(self, times: Array) -> list[Array]:
        """Configuration, velocity, acceleration, drive and wrenches of the present plan at times (n,) [s].

        After the end of the plan these are the values at its end.
        """
        return self.motion.parts(self._instants(times))

    def _instants(self, times: Array) -> Array:
        """Instants (n, nz) of the present plan at times (n,) [s]; see :meth:`at`."""
        return self.motion.along(np.clip((times - self.begin_s) / self.motion.duration_s, 0.0, 1.0))

    @functools.cached_property
    def _commanded(self) -> ca.Function:
        """Wrench commanded along the axes of driven bases (n x 1) [N, N m] as a function of an instant."""
        stage = self.motion.problem.stage
        return ca.Function("commanded", [stage.z], [ca.densify(commanded_base_wrench(stage))])

    def base_knots(self, now: float, period: float, robot: str) -> tuple[Array, Array]:
        """Commanded wrench and rate (points, axes) of a robot's base in the next period, as :meth:`knots`.

        Forces, torques, velocities and spins are along the driven axes of the root link [N, N m, m/s, rad/s].
        """
        driven, count = self.motion.problem.stage.driven, len(self.motion.problem.stage.driven.joints)
        z = self._instants(now + self.solver.lobatto.nodes * period)
        base = [k for k, name in enumerate(driven.names) if name.startswith(f"{robot}/base.") and k >= count]
        wrench = np.array(self._commanded(z.T).full())[[k - count for k in base]].T
        return wrench, self.motion.parts(z)[1][:, [driven.columns[k] for k in base]]

    def knots(self, now: float, period: float, robot: str) -> dict[str, Any]:
        """Motion of a robot's joints in the next period [s], at the points of one interval."""
        stage = self.motion.problem.stage
        model, driven = stage.scene.model, stage.driven
        times = self.solver.lobatto.nodes * period
        q, v, _, u, *_ = self.at(now + times)
        robot_drives = [k for k, name in enumerate(driven.names) if name.startswith(f"{robot}/")]
        robot_drives = [k for k in robot_drives if k < len(driven.joints)]
        joints = [model.joints[driven.joints[k]] for k in robot_drives]
        angles = np.array([[joint_angle(joint, row) for joint in joints] for row in q])
        return {
            "times": times.tolist(),
            "points": len(times),
            "joints": [driven.names[k].partition("/")[2] for k in robot_drives],
            "position": np.unwrap(angles, axis=0).tolist(),
            "rate": v[:, [driven.columns[k] for k in robot_drives]].tolist(),
            "effort": u[:, robot_drives].tolist(),
        }


def with_inertia(problem: PlanningProblem, inertia: Array | None) -> PlanningProblem:
    """Problem with an estimate of the target's inertial parameters (10,); unchanged if None."""
    return problem if inertia is None else dataclasses.replace(problem, inertia=inertia)


def continued(model: Any, state: Array, near: Array) -> Array:
    """State (nq + nv,) with each quaternion of the sign that is nearer to that of a configuration (nq,)."""
    state = state.copy()
    for joint in model.joints[1:]:
        if joint.nq == 7:
            turn = slice(joint.idx_q + 3, joint.idx_q + 7)
            state[turn] *= 1.0 if state[turn] @ near[turn] >= 0 else -1.0
    return state


def is_usable(program: PhaseChain, candidate: Solution) -> bool:
    """Whether a plan may be flown: a solution, or feasible so far."""
    g, (least, greatest) = program.constraints(candidate.w), program.limits()
    return candidate.converged or bool(np.maximum(least - g, g - greatest).max() <= GOOD)
