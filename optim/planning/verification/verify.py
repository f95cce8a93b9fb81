"""Verification of a plan, independent of the solver's own status."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from optim.planning.formulation.link_pairs import Collision, LinkPair, collisions, unseen_steps
from optim.planning.formulation.rows import row_values
from optim.planning.formulation.stage import PlanningProblem, state_after_impact
from optim.planning.solver.ipopt import Solution
from optim.planning.solver.nonlinear_program import NonlinearProgram
from optim.planning.transcription.collocation_program import first_constrained
from optim.planning.transcription.motion import Motion, PhasedMotion, normalised
from optim.planning.transcription.phase_chain import PhaseChain
from optim.planning.verification.replay import replay_motion, tip_errors
from optim.planning.verification.second_order_conditions import descent_direction
from spacerobot.common.arrays import Array
from spacerobot.elements.goals.plan_instant import BoundedRow

RESIDUAL = 1e-6
"""Maximum residual of the first-order conditions."""
FINER = 10
"""Number of instants checked in each interval."""
RELATIVE = 1e-3
"""Allowed violation between the points, relative to the limit's magnitude."""
ABSOLUTE = 1e-4
"""Allowed violation where a limit is zero [m, rad]."""
UNSEEN = 1e-3
"""Depth [m] to which a distance may be passed between two instants unseen."""


ROUNDING = 1e-8
"""Excess that counts as no violation: the solver's own tolerance."""


@dataclass(frozen=True)
class Violation:
    """Largest excess over a limit.

    Attributes:
        name, unit: Name of the limit, and the unit of the amounts.
        amount, allowed: Excess over the limit, and the excess that is allowed.
        time_s: Time of the largest excess [s].
    """

    name: str
    unit: str
    amount: float
    allowed: float
    time_s: float


@dataclass(frozen=True)
class VerificationResult:
    """Result of a plan's verification.

    Attributes:
        residual: Residual of the first-order conditions, relative to the cost.
        violations: Violation of each limit between the points, the largest first.
        replay_errors_m: Maximum distance of each tip from the plan in a replay of its torques [m].
        followed_errors_m: The same in a replay with feedback of the joints [m].
        tolerance_m: Allowed replay error [m].
        open_loop: Whether the tolerance holds for the replay without feedback too.
        saddle: Whether second-order conditions fail: the cost falls along a direction that the constraints
            allow.
    """

    residual: float
    violations: tuple[Violation, ...]
    replay_errors_m: Mapping[str, float]
    followed_errors_m: Mapping[str, float]
    tolerance_m: float
    open_loop: bool = True
    saddle: bool = False

    @property
    def status(self) -> str:
        """Classification by second-order conditions: a minimum, or a saddle point."""
        return "saddle point" if self.saddle else "minimum"

    @property
    def replay_error_m(self) -> float:
        """Maximum replay error over the tips [m]."""
        return max(self.replay_errors_m.values(), default=0.0)

    @property
    def followed_error_m(self) -> float:
        """Maximum error over the tips with feedback [m]."""
        return max(self.followed_errors_m.values(), default=0.0)

    @property
    def error_m(self) -> float:
        """Error that the tolerance limits [m]: with feedback, and for ``open_loop`` without it too."""
        return max(self.replay_error_m, self.followed_error_m) if self.open_loop else self.followed_error_m

    @property
    def fine_enough(self) -> bool:
        """Whether the mesh is fine enough."""
        return self.error_m <= self.tolerance_m and not self.exceeded

    @property
    def exceeded(self) -> tuple[Violation, ...]:
        """Violations larger than allowed."""
        return tuple(v for v in self.violations if v.amount > v.allowed)

    def failures(self) -> list[str]:
        """Reasons why the plan is refused, a clause each; none if it is accepted."""
        clauses = []
        if not self.residual <= RESIDUAL:
            clauses.append(f"the first-order residual is {self.residual:.1e}, allowed {RESIDUAL:g}")
        replayed = {"replayed": self.replay_errors_m} if self.open_loop else {}
        for how, errors in (replayed | {"followed": self.followed_errors_m}).items():
            label, error = max(errors.items(), key=lambda item: item[1], default=("", 0.0))
            if not error <= self.tolerance_m:
                clauses.append(
                    f"{how}, {label} ends up to {error:.1e} m off the plan, allowed {self.tolerance_m:g} m"
                )
        clauses += [
            f"{v.name} is passed by {v.amount:.3g} {v.unit} at {v.time_s:.3g} s, allowed {v.allowed:.3g}"
            for v in self.exceeded[:3]
        ]
        return clauses


def verify(
    phased_motion: PhasedMotion,
    program: PhaseChain,
    solution: Solution,
    scale: float,
    backend: str = "auto",
) -> VerificationResult:
    """Verify a trajectory and the multipliers found with it.

    Args:
        phased_motion, solution: The motion, and where the solver ended.
        program: Program that was solved, with interpreted functions: they give the residual.
        scale: Cost that the residual is taken relative to.
        backend: Backend of the replay: ``auto``, ``compiled`` or ``interpreted``.
    """
    # greatest distance of each tip from the plan in any phase [m], each replayed from where the one before it
    # ended, through the impact of what closes
    alone, followed, ends = dict[str, float](), dict[str, float](), list[Array]()
    for motion in phased_motion.motions:
        starts = None
        if ends:
            one, other = (state_after_impact(motion.problem.stage, end) for end in ends)
            starts = one, other
        replayed = replay_motion(motion, backend, starts)
        for greatest, states in zip((alone, followed), replayed, strict=True):
            for label, distances in tip_errors(motion, states).items():
                greatest[label] = max(greatest.get(label, 0.0), float(distances.max()))
        ends = [states[-1] for states in replayed]
    violations = [
        Violation(one.name, one.unit, float(one.excess.max()), max(one.allowed, 1e-12), begin + one.worst_s)
        for begin, motion in zip(phased_motion.begins, phased_motion.motions, strict=True)
        for one in between_points(motion)
        if one.excess.max() > ROUNDING
    ]
    violations.sort(key=lambda v: -v.amount / v.allowed)
    problem = phased_motion.motions[0].problem
    residual = first_order_residual(program, solution, scale)
    saddle = residual <= RESIDUAL and descent_direction(program, solution, scale) is not None
    return VerificationResult(
        residual, tuple(violations), alone, followed, problem.tolerance, problem.open_loop, saddle
    )


def first_order_residual(program: NonlinearProgram, solution: Solution, scale: float) -> float:
    """Maximum residual of the first-order conditions, recomputed from the solver's point and multipliers.

    The parts are the gradient of the Lagrangian and the complementarity products of multipliers and slacks,
    both divided by ``scale``, and the violation of constraints and bounds.
    """
    w, (low, high) = solution.w, program.bounds()
    jacobian = program.jacobian_pattern.copy()
    jacobian.data = program.jacobian(w)
    free = low < high
    slope = program.gradient(w) + jacobian.T @ solution.multipliers + solution.bound_multipliers
    g, (least, greatest) = program.constraints(w), program.limits()
    parts = [
        np.abs(slope[free]) / scale,
        _products(w, low, high, solution.bound_multipliers)[free] / scale,
        _products(g, least, greatest, solution.multipliers)[least < greatest] / scale,
        np.maximum(least - g, g - greatest),
        np.maximum(low - w, w - high),
    ]
    return float(max(np.max(part, initial=0.0) for part in parts))


def _products(values: Array, least: Array, greatest: Array, multipliers: Array) -> Array:
    """Multipliers times the room to the limit that they belong to: the upper one where they are positive."""
    room = np.where(multipliers > 0, greatest - values, values - least)
    held = np.where(np.isfinite(room), room, 1.0)  # without a limit, the multiplier itself must vanish
    return np.asarray(np.abs(multipliers * held))


@dataclass(frozen=True, eq=False)
class LimitExcess:
    """Excess over a limit along the motion.

    Attributes:
        name, unit, allowed: See :class:`Violation`.
        time_s: Instants at which the limit holds (n,) [s], from the phase's beginning on.
        excess: Excess at each instant (n,); negative where the limit is kept.
    """

    name: str
    unit: str
    allowed: float
    time_s: Array
    excess: Array

    @property
    def worst_s(self) -> float:
        """Time of the largest excess [s]."""
        return float(self.time_s[np.argmax(self.excess)])


def between_points(motion: Motion) -> Iterator[LimitExcess]:
    """Sample the excess over each limit on a grid ten times finer than the intervals.

    Distances of shapes have corners where another face comes nearest, so that they may be passed between two
    instants of that grid; for them it is refined until their rates rule that out.
    """
    problem, mesh = motion.problem, motion.mesh
    places = np.arange(FINER) / FINER
    z = np.vstack([motion.at(mesh, places), motion.z[-1:]])
    shares = np.append((mesh.starts[:, None] + mesh.widths[:, None] * places).ravel(), 1.0)
    time = shares * motion.duration_s
    names = limit_names(problem)
    for k, (name, unit) in names.items():
        size = np.nanmax(
            np.abs([x for x in (problem.lower[k], problem.upper[k]) if np.isfinite(x)]), initial=0.0
        )
        over = np.maximum(problem.lower[k] - z[:, k], z[:, k] - problem.upper[k])
        yield LimitExcess(name, unit, RELATIVE * float(size), time, over)
    if problem.path:
        values = row_values(problem.path, problem.stage.z, z.T)
        for row, row_samples in zip(problem.path, values, strict=True):
            held = row.held(shares, first_constrained(motion.lobatto, mesh, row.final_fraction))
            at, samples = shares[held], row_samples[held]
            if row.fastest is not None:
                at, samples = _bounded_between(motion, row, row.fastest, at, samples)
            allowed = ABSOLUTE if row.size is None else RELATIVE * row.size
            over = row.scale * np.maximum(row.lower - samples, samples - row.upper)
            yield LimitExcess(row.name, row.unit, allowed, at * motion.duration_s, over)


def _bounded_between(
    motion: Motion, row: BoundedRow, fastest: ca.SX, shares: Array, values: Array
) -> tuple[Array, Array]:
    """Instants and values of a row, with instants added until it cannot pass its lower limit unnoticed.

    A value that is a and b at two instants a time h apart, with a rate of at most s, is at least
    (a + b - s h) / 2 between them. A step is halved while this bound violates the limit by more than
    :data:`UNSEEN` and by more than 1.5 times the violation found so far. The bound s between two instants is
    taken as the larger of its values there plus their difference.

    Args:
        motion, row: The motion, and one of its rows.
        fastest: Upper bound (1x1) of the row's rate [1/s].
        shares: Fractions of the duration at which the row has been evaluated (n,).
        values: Its values there (n,).

    Returns:
        tuple: Fractions of the duration, and values.
    """
    z = motion.problem.stage.z
    bound = ca.Function("bound", [z], [ca.densify(fastest)])

    def rates_at(parts: Array) -> Array:
        return np.array(bound(motion.along(parts).T).full()).ravel()

    rates = rates_at(shares)
    unseen = UNSEEN / row.scale
    while len(shares) > 1:
        ends = np.vstack([rates[:-1], rates[1:]])
        change = (ends.max(axis=0) + np.ptp(ends, axis=0)) * np.diff(shares) * motion.duration_s / 2
        least = (values[:-1] + values[1:]) / 2 - change
        excess = float(row.lower - values.min())
        steps = np.flatnonzero(least < row.lower - max(unseen, 1.5 * excess))
        if not steps.size:
            break
        middles = (shares[steps] + shares[steps + 1]) / 2
        middle_values = row_values([row], z, motion.along(middles).T)[0]
        shares, values = np.insert(shares, steps + 1, middles), np.insert(values, steps + 1, middle_values)
        rates = np.insert(rates, steps + 1, rates_at(middles))
    return shares, values


def course_collisions(
    phased_motion: PhasedMotion, pairs: Sequence[LinkPair], *, between: bool = False
) -> list[Collision]:
    """Pairs of links that overlap along a course, looked at where its limits are, the deepest first.

    Args:
        phased_motion: The motion.
        pairs: Pairs of links to check.
        between: Whether instants are added where two of them leave an overlap deeper than :data:`UNSEEN`
            between them possible.
    """
    if not pairs:
        return []
    places = np.arange(FINER) / FINER
    q, time = list[Array](), list[Array]()
    for begin, motion in zip(phased_motion.begins, phased_motion.motions, strict=True):
        shares = np.append((motion.mesh.starts[:, None] + motion.mesh.widths[:, None] * places).ravel(), 1.0)
        model = motion.problem.stage.scene.model
        while between:
            at, v, *_ = motion.parts(motion.along(shares))
            steps = unseen_steps(pairs, model, normalised(model, at), v, shares * motion.duration_s, UNSEEN)
            if not steps.size:
                break
            shares = np.insert(shares, steps + 1, (shares[steps] + shares[steps + 1]) / 2)
        q.append(normalised(model, motion.parts(motion.along(shares))[0]))
        time.append(begin + shares * motion.duration_s)
    return collisions(pairs, model, np.vstack(q), np.concatenate(time))


def limit_names(problem: PlanningProblem) -> Mapping[int, tuple[str, str]]:
    """Name and unit of each entry of an instant that has a limit."""
    stage = problem.stage
    model, names = stage.scene.model, {}
    for joint in stage.driven.joints:
        joint_model = model.joints[joint]
        if joint_model.nq == 1:
            names[joint_model.idx_q] = (f"range of {model.names[joint]}", "rad or m")
        names[model.nq + joint_model.idx_v] = (f"rate of {model.names[joint]}", "rad/s or m/s")
    first = model.nq + 2 * model.nv
    for k, name in enumerate(stage.driven.names):
        names[first + k] = (f"torque of {name}", "N m or N")
    return {k: v for k, v in names.items() if np.isfinite([problem.lower[k], problem.upper[k]]).any()}
