"""Planned soft capture: our transcription against multiple shooting by RK4 with CasADi and IPOPT only."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.table_row import Row
from benchmarks.timing import paired
from optim.planning.formulation.formulate import formulate
from optim.planning.formulation.rows import implicit_in
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.solver.ipopt import LEAST_BARRIER, Solution, ipopt_options, one_thread, solve
from optim.planning.transcription.collocation_program import CollocationProgram, SparseSums
from optim.planning.transcription.initial_guess import initial_guess
from optim.planning.transcription.instant_functions import InstantFunctions, build_instants
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh_transfer import solve_from
from optim.planning.transcription.motion import Motion
from optim.planning.verification.replay import replay_motion
from spacerobot.common.arrays import Array
from spacerobot.dynamics import ArticulatedBody, Inertias
from spacerobot.dynamics.joints import sparse
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene

INTERVALS, LEAST, TURNS = 50, 10.0, 5
MESHES = ((4, 50, 50), (4, 50, 10), (6, 16, 16), (6, 16, 5))
"""Order and intervals of our transcription, and intervals of the mesh on which the search begins."""
MOVED = 1e-4
"""Change of all initial velocities in searches that begin from a solution [rad/s and m/s]."""
THEIRS = {"mu_init": 0.1, "constr_mult_init_max": 1000.0}
"""Options with which the baseline needs the fewest iterations of all that were tried: IPOPT's defaults."""
SAME_COST = 1e-3
"""Largest relative difference of the costs of two solutions that count as the same optimum."""
LEFT = {f"joint_{k}": {"angle_deg": 40 if k < 5 else -40} for k in range(1, 9)}
CAPTURE: Mapping[str, Any] = {
    "name": "capture",
    "robots": {
        "arm": {
            "urdf": "planar_arm.urdf",
            "base": {"joint": "planar", "position": [-0.5, 0, 0]},
            "joints": LEFT,
            "tips": {"tip": {}},
        }
    },
    "target": {
        "urdf": "rectangle.urdf",
        "base": {
            "joint": "planar",
            "position": [0.88, 1.84, 0],
            "velocity": [0.002, 0.003, 0],
            "spin_deg": [0, 0, 0.5],
        },
    },
    "pads": {
        "object": {
            "link": "target/body",
            "kind": "capsule",
            "radius": 0.1,
            "length": 0.15,
            "rotation_deg": [0, 90, 0],
        },
        "wrist": {
            "link": "arm/link_7",
            "kind": "capsule",
            "radius": 0.05,
            "length": 0.25,
            "position": [0.175, 0, 0],
            "rotation_deg": [0, 90, 0],
        },
    },
    "plan": {
        "duration": 12,
        "goals": {"mate": {"tip": "arm/tip", "frame": "mate_1"}},
        "costs": {"torque": 1e-3, "joint_acceleration": 1, "base_rotation": 1},
        "limits": {"torque": 2.5, "base_rotation_deg": 10},
        "keep_out": {"object": {"between": ["wrist", "object"], "distance": 0.1}},
    },
    "simulation": {"duration": 12, "output_step": 0.1},
}
"""The left half of the scenario ``docking``, without its cone."""


@dataclass(frozen=True, eq=False)
class MeasuredSolution:
    """Solution by one of the two formulations.

    Attributes:
        motion, cost, converged: Motion, its cost, and whether the solver converged.
        iterations: Numbers of iterations on each mesh, as text.
        in_functions: Share of the time in the problem's functions and derivatives; the rest is that of the
            solver, most of it the factorisation of its linear systems.
    """

    motion: Motion
    cost: float
    converged: bool
    iterations: str
    in_functions: float

    @property
    def error(self) -> float:
        """Largest error of a configuration at the knots [m, rad] in a replay of the torques."""
        nq, knots = self.motion.problem.stage.scene.model.nq, self.motion.lobatto.points - 1
        return float(np.abs(replay_motion(self.motion)[0][:, :nq] - self.motion.z[::knots, :nq]).max())


def rows() -> list[Row]:
    """Rows of one solve from the same guess on each of our meshes, without the time to build functions.

    Ours may begin on a coarser mesh, from which unknowns and multipliers are interpolated.
    """
    problem = formulate(build_scene(validate(dict(CAPTURE))))
    instants, knots = build_instants(problem), Lobatto.of_order(2)
    first = initial_guess(problem, knots, INTERVALS)
    scale = CollocationProgram(problem, instants, knots, INTERVALS).objective(first.unknowns)
    shooting = Shooting(problem, first, scale)
    cold = [_row(problem, instants, shooting, scale, *mesh) for mesh in MESHES]
    # both restart from their solution, with its multipliers, for a changed initial state
    order, intervals, _ = MESHES[0]
    lobatto, start = Lobatto.of_order(order), problem.fixed.copy()
    program = CollocationProgram(problem, instants, lobatto, intervals)
    before = solve(program, initial_guess(problem, lobatto, intervals).unknowns, scale=scale)
    start[-program.nv :] += MOVED
    moved = dataclasses.replace(problem, fixed=start)
    program = CollocationProgram(moved, instants, lobatto, intervals)
    shooting.solve()
    near, solutions = shooting.solution, dict[str, MeasuredSolution]()

    def ours() -> None:
        solution = solve(program, before.w, before)
        z, duration = program.split(solution.w)
        motion = Motion(moved, lobatto, program.mesh, duration, z)
        solutions["ours"] = MeasuredSolution(
            motion,
            program.objective(solution.w),
            solution.converged,
            str(solution.iterations),
            solution.evaluations_s / solution.seconds,
        )

    def theirs() -> None:
        solutions["theirs"] = shooting.solve(near, start)

    warm_row = _compared(
        program, shooting, (ours, theirs), solutions, f"of order {order}", ", from a solution nearby"
    )
    return [*cold, warm_row]


def _row(
    problem: PlanningProblem, instants: InstantFunctions, shooting: Shooting, scale: float, *mesh: int
) -> Row:
    order, intervals, coarse = mesh
    lobatto = Lobatto.of_order(order)
    program = CollocationProgram(problem, instants, lobatto, intervals)
    first = initial_guess(problem, lobatto, coarse)
    solutions: dict[str, MeasuredSolution] = {}

    def ours() -> None:
        runs: tuple[Solution, ...]
        if coarse == intervals:
            runs = (solve(program, first.unknowns, scale=scale),)
        else:
            runs = solve_from(first, program, scale=scale)
        z, duration = program.split(runs[-1].w)
        motion = Motion(problem, lobatto, program.mesh, duration, z)
        many = " + ".join(str(one.iterations) for one in runs)
        inside = sum(one.evaluations_s for one in runs) / sum(one.seconds for one in runs)
        cost, converged = program.objective(runs[-1].w), runs[-1].converged
        solutions["ours"] = MeasuredSolution(motion, cost, converged, many, inside)

    def theirs() -> None:
        solutions["theirs"] = shooting.solve()

    coarse_words = f", begun on {coarse}" if coarse < intervals else ""
    return _compared(program, shooting, (ours, theirs), solutions, f"of order {order}", coarse_words)


def _compared(
    program: CollocationProgram,
    shooting: Shooting,
    jobs: tuple[Callable[[], None], Callable[[], None]],
    solutions: Mapping[str, MeasuredSolution],
    *words: str,
) -> Row:
    """Row of two jobs that store their solutions."""
    times = paired(*jobs, turns=TURNS)
    one, other = solutions["ours"], solutions["theirs"]
    difference = abs(one.cost - other.cost) / abs(other.cost)
    same = one.converged and other.converged and difference <= SAME_COST
    steps = [sum(map(int, each_side.iterations.split(" + "))) for each_side in (one, other)]
    each = [
        1e3 * spent / max(count, 1)
        for spent, count in zip((times.first_s, times.second_s), steps, strict=True)
    ]
    note = (
        f"{one.iterations} and {other.iterations} iterations of {each[0]:.3g} and {each[1]:.3g} ms, "
        f"{one.in_functions:.0%} and {other.in_functions:.0%} of them in the problem's functions; "
        f"costs {one.cost:.6f} and {other.cost:.6f}; "
        f"replayed {one.error:.1e} and {other.error:.1e} off"
    )
    order, coarse_words = words
    return Row(
        f"soft capture planned, {program.intervals} intervals {order}, {program.size} unknowns{coarse_words}",
        f"RK4 multiple shooting by CasADi's virtual machine and IPOPT, {INTERVALS} intervals, "
        f"{shooting.size} unknowns",
        f"{times.first_s:.2f} s",
        f"{times.second_s:.2f} s",
        times.ratio,
        f"at least {LEAST:g}",
        same and times.ratio >= LEAST,
        note if same else f"not the same optimum; {note}",
        {"costs": (one.cost, other.cost), "operations_of_a_step": shooting.operations},
    )


class Shooting:
    """Multiple shooting: one step of RK4 in each interval, torques linear between the knots.

    Derivatives are exact. Those of one step are expressions without common subexpressions, and are mapped.

    Args:
        problem: Planning problem with a fixed duration.
        first: First guess, whose points are the knots.
        scale: Magnitude of the cost.
    """

    def __init__(self, problem: PlanningProblem, first: Motion, scale: float) -> None:
        self._first = first
        stage, count = problem.stage, first.intervals
        nx, nu = len(problem.fixed), stage.u.numel()
        wide = nx + nu
        self.size = wide * (count + 1)
        w = ca.MX.sym("w", self.size)
        # unknowns of each interval's ends (count, 2 wide)
        places = np.arange(count)[:, None] * wide + np.arange(2 * wide)
        pairs = ca.reshape(w[places.ravel().tolist()], 2 * wide, count)
        problem_of, options, self.operations = _program(
            _one(problem, first.duration_s / count), count, w, pairs
        )
        state_places = np.r_[0:nx, nx + stage.a.numel() : stage.z.numel()]
        self._places, guessed = state_places, first.z[:, state_places].ravel()
        kinds = {
            "cold": ipopt_options(1000, scale) | THEIRS,
            "warm": ipopt_options(1000, scale, LEAST_BARRIER),
        }
        self._solvers = {
            name: ca.nlpsol(name, "ipopt", problem_of, options | {"ipopt": ipopt})
            for name, ipopt in kinds.items()
        }
        self.solution: Mapping[str, ca.DM] = {}
        low, high = (np.tile(side[state_places], (count + 1, 1)) for side in (problem.lower, problem.upper))
        low[0, :nx] = high[0, :nx] = problem.fixed
        sides = []
        for key in ("lower", "upper"):
            path, goals = ([getattr(row, key) for row in part] for part in (problem.path, problem.goal))
            sides.append(np.r_[np.tile(np.r_[np.zeros(nx), path], count), goals])
        self._arguments: dict[str, Any] = {"x0": guessed, "lbx": low.ravel(), "ubx": high.ravel()}
        self._arguments |= {"lbg": sides[0], "ubg": sides[1]}

    def solve(self, near: Mapping[str, ca.DM] | None = None, start: Array | None = None) -> MeasuredSolution:
        """Solve from the first guess, or from a solution with its multipliers for another initial state."""
        arguments, solver = self._arguments, self._solvers["cold" if near is None else "warm"]
        if near is not None and start is not None:
            sides = {side: arguments[side].copy() for side in ("lbx", "ubx")}
            for bounds in sides.values():
                bounds[: len(start)] = start
            arguments = (
                arguments | sides | {"x0": near["x"], "lam_g0": near["lam_g"], "lam_x0": near["lam_x"]}
            )
        begin = time.perf_counter()
        with one_thread():
            self.solution = solver(**arguments)
        spent = time.perf_counter() - begin
        stats, z = solver.stats(), np.zeros_like(self._first.z)
        inside = sum(value for key, value in stats.items() if key.startswith("t_wall_nlp_")) / spent
        z[:, self._places] = np.array(self.solution["x"]).reshape(len(z), -1)
        motion = dataclasses.replace(self._first, z=z)
        return MeasuredSolution(
            motion, float(self.solution["f"]), bool(stats["success"]), str(stats["iter_count"]), inside
        )


def _program(
    parts: tuple[ca.SX, ca.SX, ca.SX, tuple[list[ca.SX], list[ca.SX]]], count: int, w: ca.MX, pairs: ca.MX
) -> tuple[dict[str, ca.MX], dict[str, Any], int]:
    """Program of all intervals in the form of CasADi's interface to IPOPT, its options, and its operations.

    ``parts`` are what :func:`_one` returns; the operations are those of the second derivatives of one step.
    """
    pair, step_rows, goal_rows, held = parts

    def function(name: str, arguments: list[ca.SX], rows: ca.SX) -> ca.Function:
        """Function of both ends, with the constants of the derivatives substituted."""
        return ca.Function(name, arguments, ca.substitute([ca.densify(rows)], *held), {"cse": True})

    wide, inner, goals = pair.numel() // 2, step_rows.numel() - 1, goal_rows.numel()
    size, n = wide * (count + 1), np.arange(count)[:, None]
    cost_slopes = function("step_gradient", [pair], ca.densify(ca.jacobian(step_rows[-1], pair)))
    rows = []
    for name, rows_of in (("step", step_rows), ("goal", goal_rows)):
        by = ca.SX.sym("weights", rows_of.numel())
        slopes, bends = ca.jacobian(rows_of, pair), ca.triu(ca.hessian(ca.dot(by, rows_of), pair)[0])
        rows += [function(name, [pair], rows_of), function(f"{name}_slopes", [pair], slopes.nz[:])]
        rows.append(function(f"{name}_bends", [pair, by], bends.nz[:]))
        rows += [[np.array(k) for k in each.sparsity().get_triplet()] for each in (slopes, bends)]
    step, slopes_of, bends_of, at, bent, goal, ends, end_bends, end_at, end_bent = rows
    last, shift, end_shift = pairs[:, -1], n * wide, (count - 1) * wide
    values = step.map(count)(pairs)
    f, g = ca.sum2(values[inner, :]), ca.vertcat(ca.vec(values[:inner, :]), goal(last))
    by_pair = slopes_of.map(count)(pairs)
    others = np.flatnonzero(at[0] < inner).tolist()
    columns = np.arange(2 * wide)
    of_cost = cost_slopes.map(count)(pairs)
    gradient = _summed([(0 * n + 0 * columns, shift + columns)], (1, size), ca.vec(of_cost)).T
    places = [(n * inner + at[0][others], shift + at[1][others])]
    places.append((count * inner + end_at[0], end_shift + end_at[1]))
    nonzeros = ca.vertcat(ca.vec(by_pair[others, :]), ends(last))
    jacobian = _summed(places, (g.numel(), size), nonzeros)
    factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", g.numel())
    weights = ca.vertcat(ca.reshape(multipliers[: count * inner], inner, count), ca.repmat(factor, 1, count))
    nonzeros = ca.vertcat(ca.vec(bends_of.map(count)(pairs, weights)), end_bends(last, multipliers[-goals:]))
    places = [(shift + bent[0], shift + bent[1]), (end_shift + end_bent[0], end_shift + end_bent[1])]
    hessian, p = _summed(places, (size, size), nonzeros), ca.MX.sym("p", 0)
    arguments = [w, p, factor, multipliers]
    names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    options = {
        "grad_f": ca.Function("grad_f", [w, p], [f, ca.densify(gradient)], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("hess_lag", arguments, [hessian], *names),
        "no_nlp_grad": True,
        "print_time": False,
        "record_time": True,
    }
    return {"x": w, "p": p, "f": f, "g": g}, options, int(bends_of.n_instructions())


def _one(
    problem: PlanningProblem, length: float
) -> tuple[ca.SX, ca.SX, ca.SX, tuple[list[ca.SX], list[ca.SX]]]:
    """Both ends of an interval (x, u, x, u), its rows with its cost as the last one, and the goal's rows.

    Normals of keep-outs are held constant in derivatives, as in ours: what stands for them, and they.
    """
    about = implicit_in(problem.path)
    stage, model = problem.stage, problem.stage.scene.model
    force = -sparse(np.asarray(model.damping)) * stage.v
    for k, column in enumerate(stage.driven.columns):
        force[column] += stage.u[k]
    body = ArticulatedBody.factorise(model, stage.kinematics, Inertias.from_model(model))
    x, rate = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.rate, body.acceleration(force))
    path, goal, cost = ca.substitute(
        [
            ca.vertcat(*(row.value for row in problem.path)),
            ca.vertcat(*(row.value for row in problem.goal)),
            problem.cost,
        ],
        [stage.a],
        [ca.densify(rate[model.nq :])],
    )
    moving = ca.Function("moving", [x, stage.u], [ca.densify(ca.vertcat(rate, cost))])
    symbols = [one.symbol for one in about]
    path_of = ca.Function("path", [x, stage.u, *symbols], [ca.densify(path)])
    found = [one.function(one.arguments) for one in about if one.function is not None]
    normals = ca.Function("normals", [x], found)
    goal_of = ca.Function("goal", [x, stage.u], [ca.densify(goal)])
    nx, wide = x.numel(), x.numel() + stage.u.numel()
    pair = ca.SX.sym("pair", 2 * wide)
    begin, u, end, after = pair[:nx], pair[nx:wide], pair[wide : wide + nx], pair[wide + nx :]
    middle = (u + after) / 2
    one = moving(begin, u)
    two = moving(begin + length / 2 * one[:nx], middle)
    three = moving(begin + length / 2 * two[:nx], middle)
    four = moving(begin + length * three[:nx], after)
    step = length / 6 * (one + 2 * two + 2 * three + four)
    rows_of = ca.vertcat(
        end - begin - step[:nx], path_of(end, after, *symbols), step[nx] + length * problem.time_weight
    )
    return pair, rows_of, goal_of(end, after), (symbols, normals.call([end]))


def _summed(places: list[tuple[Any, Any]], shape: tuple[int, int], values: ca.MX) -> ca.MX:
    """Sparse matrix of entries, those in the same place summed."""
    sums = SparseSums.of([np.broadcast_arrays(*place) for place in places], shape)
    matrix, given = sums.matrix, len(sums.place)
    adding = ca.Sparsity.triplet(matrix.nnz, given, sums.place.tolist(), list(range(given)))
    pattern = ca.Sparsity(*shape, matrix.indptr.tolist(), matrix.indices.tolist())
    return ca.MX(pattern, ca.mtimes(ca.DM(adding, 1.0), values))
