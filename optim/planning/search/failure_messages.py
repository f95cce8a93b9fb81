"""Messages of a search without a plan: infeasible, budget exhausted, bad initial guess; with remedies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from optim.planning.solver.elastic import ElasticProgram
from optim.planning.solver.ipopt import TIME_LIMIT, Solution
from optim.planning.transcription.phase_chain import PhaseChain
from optim.planning.verification.verify import limit_names
from spacerobot.common.arrays import Array
from spacerobot.scenario.plan import PlanSection

VIOLATED = 1e-6
"""Smallest violation that messages report [unit of the constraint]."""
NAMED = 4
"""Maximum number of constraints and limits named in a message."""
SHARE = 0.05
"""Multiplier relative to the strongest limit's from which another limit is named."""


def limit_message(program: PhaseChain, solution: Solution, plan: PlanSection) -> str:
    """Message of a search that reached a limit on time or iterations, or failed numerically; else empty.

    Args:
        program, solution: Program, and the solver's last iterate.
        plan: Plan section; the message names its limits.
    """
    left = f"where it stopped, violated most: {largest_violations(program, solution.w)}"
    if solution.status == TIME_LIMIT:
        return (
            f"time exhausted: `plan.time_limit`, {plan.time_limit:g} s of processor time, was over in "
            f"iteration {solution.iterations}; {left}; raise `time_limit`, or try fewer `intervals`"
        )
    if solution.status == "Maximum_Iterations_Exceeded":
        return (
            f"iterations exhausted: {solution.iterations} of `plan.iterations` were not enough; {left}; "
            "raise `iterations`, or try further first guesses (`starts: 5`) or another `duration.guess`"
        )
    if solution.status == "Invalid_Number_Detected":
        return (
            f"the search came to where the motion cannot be evaluated, in iteration {solution.iterations}; "
            "try further first guesses (`starts: 5`), or another `duration.guess`"
        )
    return ""


def bad_guess_message(program: PhaseChain, first: Array) -> str | None:
    """Message that names functions that cannot be evaluated at an initial guess; None if all can.

    Args:
        program, first: Program, and its initial unknowns.
    """
    g, cost = program.constraints(first), program.objective(first)
    wrong = [name for name, rows in _rows(program) if not np.isfinite(g[rows]).all()]
    if not np.isfinite(cost):
        wrong.append("the cost")
    if not wrong:
        return None
    return (
        "bad start: the first guess cannot be evaluated, for these are no numbers: "
        f"{', '.join(wrong[:NAMED])}; try further first guesses "
        "(`starts: 5`), another `duration.guess`, or begin elsewhere"
    )


def infeasibility_message(
    program: PhaseChain, elastic: ElasticProgram, solution: Solution, status: str
) -> str:
    """Message of a search without a feasible motion, from the elastic program's solution.

    Args:
        program: Program that has no solution.
        elastic, solution: Elastic form of the program, and its solution.
        status: IPOPT's status at the end of the program itself.
    """
    w, (low, high) = solution.w[: program.size], program.bounds()
    hints = "relax them, or try further first guesses (`starts: 5`)"
    if not solution.converged:
        return (
            f"no motion that meets all constraints was found ({status.replace('_', ' ').lower()}), nor the "
            "least violation; "
            f"violated most where the search ended: {largest_violations(program, w)}; {hints}"
        )
    # Multipliers of the bounds of the program's unknowns (size,). The solver omits those of fixed durations;
    # they follow from a stationary Lagrangian.
    pressed = solution.bound_multipliers[: elastic.program.size].copy()
    pattern = elastic.jacobian_pattern.copy()
    pattern.data = elastic.jacobian(solution.w)
    slope = elastic.gradient(solution.w) + pattern.T @ solution.multipliers
    for end in np.cumsum([one.size for one in program.programs]) - 1:
        if low[end] == high[end]:
            pressed[end] = -slope[end]
    # multipliers times magnitudes of the bounds, by name, and those of the durations
    pulls, times, first = dict[str, float](), dict[str, float](), 0
    for one in program.programs:
        block = slice(first, first + one.size)
        limit = np.where(pressed[block] > 0, high[block], low[block])
        fixed = low[block] == high[block]
        fixed[-1] = False  # a duration that is given is a limit, too
        pull = np.where(np.isfinite(limit) & ~fixed, np.abs(pressed[block]), 0.0)
        pull = pull * np.maximum(np.abs(np.where(np.isfinite(limit), limit, 0.0)), 1e-3)
        per_point = pull[:-1].reshape(one.points, one.nz).sum(axis=0)
        for k, (name, _) in limit_names(one.problem).items():
            pulls[name] = pulls.get(name, 0.0) + float(per_point[k])
        times[f"the duration (at most {high[block][-1]:g} s)"] = float(pull[-1]) * (pressed[block][-1] > 0)
        first += one.size
    most = max(pulls.values(), default=0.0)
    worst = sorted(pulls, key=lambda name: -pulls[name])[:NAMED]
    named = [name for name in worst if most > VIOLATED and pulls[name] >= SHARE * most]
    limits = named + [name for name, pull in times.items() if pull > VIOLATED]
    held = f", held back by {', '.join(limits)}" if limits else ""
    return (
        "infeasible, as far as can be seen from this first guess: the least violation leaves "
        f"{largest_violations(program, w)}{held}; {hints}"
    )


def largest_violations(program: PhaseChain, w: Array) -> str:
    """Names and amounts of the largest constraint violations, for a message.

    Args:
        program, w: Program, and its unknowns.
    """
    g, (least, greatest) = program.constraints(w), program.limits()
    over, violations = np.maximum(np.maximum(least - g, g - greatest), 0.0), dict[str, tuple[float, str]]()
    # scale and unit of each constraint's violation, by name
    scales = {"equations of motion": (1.0, "N or N m")}
    for one in program.programs:
        scales |= {row.name: (row.scale, row.unit) for row in (*one.problem.path, *one.problem.goal)}
    for name, rows in _rows(program):
        scale, unit = scales.get(name, (1.0, "m or rad"))
        value = float(np.max(over[rows], initial=0.0)) * scale
        violations[name] = max((value, unit), violations.get(name, (0.0, unit)))
    worst = sorted(violations.items(), key=lambda item: -item[1][0])
    named = [f"{name} ({value:.2g} {unit})" for name, (value, unit) in worst if value > VIOLATED][:NAMED]
    return ", ".join(named) or "nothing"


def soft_rows(program: PhaseChain) -> npt.NDArray[np.int64]:
    """Constraints that an elastic program may violate: goals, and limits along the path.

    Equations of motion, collocation and grasp constraints stay hard.
    """
    blocks, first = list[npt.NDArray[np.int64]](), 0
    for one in program.programs:
        hard = np.zeros((one.points, one.per_point), dtype=bool)
        hard[:, : one.nv] = True
        for k, row in enumerate(one.problem.path):
            hard[:, one.nv + k] = row.lower == row.upper
        soft = np.concatenate(
            [np.zeros(one.defects, dtype=bool), ~hard.ravel(), np.ones(len(one.problem.goal), dtype=bool)]
        )
        blocks.append(first + np.flatnonzero(soft))
        first += one.rows
    rows, (least, greatest) = np.concatenate(blocks), program.limits()
    return rows[np.isfinite(least[rows]) | np.isfinite(greatest[rows])]


def _rows(program: PhaseChain) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Name and row indices of each constraint."""
    first = 0
    for one in program.programs:
        yield "continuity", first + np.arange(one.defects)
        # rows of the constraints at mesh points
        at = (first + one.defects) + np.arange(one.points * one.per_point).reshape(one.points, one.per_point)
        yield "equations of motion", at[:, : one.nv].ravel()
        for k, row in enumerate(one.problem.path):
            yield row.name, at[:, one.nv + k]
        goals = first + one.rows - len(one.problem.goal)
        for k, row in enumerate(one.problem.goal):
            yield row.name, np.array([goals + k])
        first += one.rows
    if first < program.rows:
        yield "continuity between phases", np.arange(first, program.rows)
