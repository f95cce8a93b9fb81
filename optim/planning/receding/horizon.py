"""A plan that is made anew again and again: for what is left of the first one's duration, then on and on.

Intervals keep their length, as far as the times of the plans allow, so that what is left of one plan lies on
the mesh of the next: unknowns and multipliers are carried over as they are, and a few iterations are enough.
Behind the end of the first plan each one keeps the goal for a short while from where it begins.
"""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from optim.planning.formulation.stage import Problem
from optim.planning.searches.bench import Bench
from optim.planning.searches.make import fault_of
from optim.planning.searches.search import search
from optim.planning.solver.solve import PATIENCE, Solved, solve
from optim.planning.transcription.guess import guess
from optim.planning.transcription.motion import Course, Motion
from optim.planning.transcription.program import Program
from optim.planning.transcription.refine import constrained, onward
from optim.planning.verification.clearance import course_collisions
from optim.planning.verification.replay import joint_angle
from spacerobot.arrays import Array
from spacerobot.errors import NoPlanError

FEWEST = 4
"""Intervals of a plan at least, where the first one has as many."""
ROUNDING = 1e-9
"""Of numbers of intervals, and of times in parts of a period."""
GOOD = 1e-4
"""Greatest violation [m, rad, N or N m] of a plan that is flown before the solver is content."""
ROOM = 1e-6
"""By which a limit that is violated where a plan begins is wider than that."""


@dataclass
class Horizon:
    """The plan that is flown now, and what was done for all of them.

    Attributes
    ----------
    bench
        The problem.
    motion, solved, program
        The plan, its solution, and what that solves.
    full
        Duration of the first plan [s].
    since
        When the present plan began [s].
    least
        Shortest time that a plan looks ahead [s].
    iterations, seconds
        Of each solve.
    missed, unfinished
        How many led to no plan, and to one that was flown before the solver was content.
    """

    bench: Bench
    motion: Motion
    solved: Solved
    program: Program
    full: float
    least: float
    since: float = 0.0
    iterations: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    missed: int = 0
    unfinished: int = 0

    @classmethod
    def of(cls, bench: Bench, seen: Array, least: float) -> Horizon:
        """With the first plan, from a first guess.

        Parameters
        ----------
        bench
            The problem.
        seen
            Configuration and velocity at its beginning (nq + nv,), as they seem to be.
        least
            Shortest time that a plan looks ahead [s].

        Raises
        ------
        NoPlanError
            If none is found.
        """
        own = dataclasses.replace(bench, problem=dataclasses.replace(bench.problem, fixed=seen))
        ask = own.asked(refine=False)
        found = search(own, ask)
        if found.solved is None:
            raise NoPlanError(str(fault_of(found)), source=bench.scene.source, where="plan")
        motion, bench = own.motion(ask, found), bench.keeping_apart(found.apart)
        return cls(
            bench,
            motion,
            found.solved,
            Program(motion.problem, bench.instants, bench.lobatto, motion.mesh),
            motion.duration_s,
            least,
            iterations=[one.iterations for one in found.solves],
            seconds=[one.seconds for one in found.solves],
        )

    def renews(self, begin: float) -> bool:
        """Whether a plan is to begin at a time [s]: the last one before the end is kept until there.

        None where the shortest time to look ahead is longer than the first plan.
        """
        left, rounding = self.full - begin, ROUNDING * self.full
        return self.least <= self.full and (left > self.least - rounding or left < rounding)

    def renew(self, begin: float, seen: Array, iterations: int) -> None:
        """Plan anew from a time on, from the last plan; where that leads nowhere, from a first guess.

        Where none is found the last one stays.

        Parameters
        ----------
        begin
            When the plan begins [s].
        seen
            Configuration and velocity then (nq + nv,), as they seem to be.
        iterations
            At most.
        """
        clock, bench, scale = time.perf_counter(), self.bench, self.solved.scale
        problem = self._problem(bench, begin, seen)
        intervals = self._intervals(problem.duration[0])
        program = Program(problem, bench.instants, bench.lobatto, intervals)
        warm = onward(self.solved, self.program, program, self._gone(begin))
        found = solve(program, self._ahead(program, begin), warm, iterations=min(iterations, PATIENCE))
        spent = found.iterations
        if not good(program, found) and spent < iterations:
            fresh = guess(problem, bench.lobatto, intervals).unknowns
            found = solve(program, fresh, scale=scale, iterations=iterations - spent)
            spent += found.iterations
        while good(program, found):
            z, duration = program.split(found.w)
            motion = Motion(problem, bench.lobatto, program.mesh, duration, z)
            wider = bench.keeping_apart(course_collisions(Course((motion,)), bench.pairs))
            if wider is bench:
                self.bench, self.motion = bench, motion
                self.solved, self.program, self.since = found, program, begin
                self.unfinished += not found.converged
                break
            # links collide: once more from here, with the keep-out zones that this plan needs
            problem, before, bench = self._problem(wider, begin, seen), program, wider
            program = Program(problem, bench.instants, bench.lobatto, intervals)
            warm = constrained(found, before, program)
            left = max(iterations - spent, 1)
            found = solve(program, found.w, warm, scale=scale, iterations=min(left, PATIENCE))
            spent += found.iterations
        else:
            self.missed += 1
        self.iterations.append(spent)
        self.seconds.append(time.perf_counter() - clock)

    def _problem(self, bench: Bench, begin: float, seen: Array) -> Problem:
        """The problem from a time on.

        What holds for a last part of the whole holds from the same time on, and no more behind the end. A
        limit that is violated already is not to be violated more.
        """
        problem, left = bench.problem, self.full - begin
        behind = left < ROUNDING * self.full
        duration = self.least if behind else left
        z = np.concatenate(self.at(np.array([begin])), axis=1)[0]
        z[: seen.size] = seen
        values = bench.instants.call("values", z[:, None])[seen.size :, 0]
        rows = []
        for row, value in zip(problem.path, values, strict=False):
            if behind and row.last < 1:
                rows.append(dataclasses.replace(row, lower=-np.inf, upper=np.inf))
                continue
            last = min(row.last * self.full / duration, 1.0)
            low, high = row.lower, row.upper
            if last == 1:
                low = low if value >= low else value - ROOM
                high = high if value <= high else value + ROOM
            rows.append(dataclasses.replace(row, last=last, lower=low, upper=high))
        return dataclasses.replace(problem, path=tuple(rows), fixed=seen, duration=(duration,) * 3)

    def _intervals(self, left: float) -> int:
        """How many intervals of about the first plan's length there are in a time [s]."""
        whole = self.bench.plan.intervals
        return max(min(whole, FEWEST), int(np.ceil(whole * left / self.full - ROUNDING)))

    def _gone(self, begin: float) -> float:
        """Part of the present plan that is over where the next one begins, if both end together."""
        return (begin - self.since) / self.motion.duration_s if begin < self.full * (1 - ROUNDING) else 0.0

    def _ahead(self, program: Program, begin: float) -> Array:
        """Unknowns of what is left of the present plan, and on as everything moves at its end."""
        duration, model = program.problem.duration[0], program.problem.stage.scene.model
        end = self.since + self.motion.duration_s
        times = begin + program.lobatto.times(program.mesh, duration)
        q, v, a, u, w = self.at(np.minimum(times, end))
        for k, late in enumerate(times - end):
            if late > ROUNDING * duration:
                q[k], a[k], u[k] = pin.integrate(model, q[k], v[k] * late), 0.0, 0.0
        z = np.hstack([q, v, a, u, w])
        z[0, : program.nx] = program.problem.fixed
        return np.append(z.ravel(), duration)

    def at(self, times: Array) -> list[Array]:
        """Configuration, velocity, acceleration, drive and wrenches of the present plan at times (n,) [s].

        Behind its end they are those at its end.
        """
        parts = np.clip((times - self.since) / self.motion.duration_s, 0.0, 1.0)
        return self.motion.parts(self.motion.along(parts))

    def knots(self, now: float, period: float, robot: str) -> dict[str, Any]:
        """What a robot's joints do in a period [s] from now on, at the points of one interval."""
        stage = self.motion.problem.stage
        model, driven = stage.scene.model, stage.driven
        times = self.bench.lobatto.nodes * period
        q, v, _, u, *_ = self.at(now + times)
        own = [k for k, name in enumerate(driven.names) if name.startswith(f"{robot}/")]
        own = [k for k in own if k < len(driven.joints)]
        joints = [model.joints[driven.joints[k]] for k in own]
        angles = np.array([[joint_angle(joint, row) for joint in joints] for row in q])
        return {
            "times": times.tolist(),
            "points": len(times),
            "joints": [driven.names[k].partition("/")[2] for k in own],
            "position": np.unwrap(angles, axis=0).tolist(),
            "rate": v[:, [driven.columns[k] for k in own]].tolist(),
            "effort": u[:, own].tolist(),
        }


def good(program: Program, found: Solved) -> bool:
    """Whether a plan may be flown: a solution, or feasible so far."""
    g, (least, greatest) = program.constraints(found.w), program.limits()
    return found.converged or bool(np.maximum(least - g, g - greatest).max() <= GOOD)
