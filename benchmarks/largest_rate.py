"""Largest tumbling rate of Envisat with a plan: ``python -m benchmarks.largest_rate [FOLDER]``.

The tumbling of ``envisat`` about the intermediate axis is raised from 5 deg/s. Each rate is planned from the
verified plan of the rate below it and on its meshes, then refined and verified by replay. If no plan is
found, the step is halved, until rates with and without a plan differ by ``PRECISE``. Without a plan, the
elastic program gives the smallest violation of goals and limits. It is a local minimum, which is evidence,
not a proof; :func:`beyond_reach` bounds the rate from above. The plan of the largest rate is written to the
folder, ``out/largest_rate`` by default, data to ``docs/data``, the figure to ``docs/images``.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

import spacerobot as sr
from benchmarks import history
from benchmarks.feasible_range import feasible_range
from optim.planning.formulation.formulate import plan_section
from optim.planning.output.plan_folder import write
from optim.planning.search.failure_messages import soft_rows
from optim.planning.search.make_plan import PLAN, failure_message, plan_result
from optim.planning.search.plan_solver import PlanSolver, SolveResult
from optim.planning.search.solve_request import BARRIER, solve_request
from optim.planning.search.warm_start import FILE as PLAN_FILE
from optim.planning.search.warm_start import stored_motion
from optim.planning.solver.elastic import ElasticProgram
from optim.planning.solver.ipopt import Solution, solve
from optim.planning.solver.nonlinear_program import NonlinearProgram
from optim.planning.transcription.phase_chain import PhaseChain
from spacerobot.common.files import write_bytes, write_text
from spacerobot.scene import Scene
from viz.figures.style import to_bytes

AXIS, PLACE = np.array([0.00522422, 0.99701949, -0.07697305]), np.array([7.2, 0.0, 0.4])
"""Intermediate axis of Envisat, and initial position of the servicer [m], both in Envisat's axes."""
FIRST, STEP, PRECISE = 5.0, 0.5, 0.03
"""First rate and first step [deg/s], and the step relative to the rate at which the search ends."""
ITERATIONS, RELAXED = 250, 100
PATIENT = {"plan.iterations": ITERATIONS, "plan.time_limit": 1800, "plan.max_intervals": 120}
FORCE = 176.0
"""Limit of the base's force along each of its axes in the scenario [N]."""
RATES = 30
"""Approximate number of planned rates, by which the planner decides to compile."""
FEASIBLE = 1e-6
SCENARIO, DATA, FIGURE = "envisat", "docs/data/envisat_rates.json", "docs/images/envisat_rates.png"


def directions() -> dict[str, float]:
    """Slopes of the scenario's numbers by the rate [1/(deg/s)]: both bodies turn together."""
    slopes = dict[str, float]()
    for path, vector in (
        ("target.base.spin_deg", AXIS),
        ("robots.servicer.base.spin_deg", AXIS),
        ("robots.servicer.base.velocity", np.cross(np.radians(AXIS), PLACE)),
    ):
        slopes |= {f"{path}.{k}": float(value) for k, value in enumerate(vector)}
    return slopes


def scene_at(rate: float) -> Scene:
    """Scene of the scenario at a rate [deg/s], with more iterations and time for its plan."""
    return sr.load_scene(SCENARIO, {path: rate * each for path, each in directions().items()} | PATIENT)


def beyond_reach(rate: float) -> float:
    """Distance [m] by which every plan misses the ring at the end of the approach, if it is positive.

    Until then only the base's force moves the servicer's centre of mass c. After T it is therefore no
    farther from c + T c' than F T^2 / (2 m), with F the largest force, along a diagonal of the base's axes.
    The gripper is at most

        R = sum_k | (1 - M_k / m) d_k - m_k / m c_k |

    from it, with d_k from the origin of link k to that of the next one, c_k its centre of mass, and M_k the
    mass of all links farther out. Envisat turns steadily about a principal axis, and the ring with it.

    Args:
        rate: Rate of Envisat [deg/s].
    """
    scene = scene_at(rate)
    model, (servicer,) = scene.model, scene.robots
    frame, ring = scene.tips[0].frame, model.getFrameId("target/ring")
    data, plan = model.createData(), plan_section(scene).by_phase["approach"]
    pin.centerOfMass(model, data, scene.q, scene.v)
    pin.updateFramePlacements(model, data)
    chain = servicer.subtree
    masses = np.array([model.inertias[joint].mass for joint in chain])
    centres = [data.oMi[joint].act(model.inertias[joint].lever) for joint in chain]
    speeds = [
        data.v[joint].linear + np.cross(data.v[joint].angular, model.inertias[joint].lever) for joint in chain
    ]
    total = float(masses.sum())
    centre = masses @ np.array(centres) / total
    velocity = masses @ [data.oMi[joint].rotation @ v for joint, v in zip(chain, speeds, strict=True)] / total
    reach = 0.0
    for k, joint in enumerate(chain):
        outward = model.jointPlacements[chain[k + 1]] if k + 1 < len(chain) else model.frames[frame].placement
        lever = model.inertias[joint].lever
        part = (1 - masses[k + 1 :].sum() / total) * outward.translation - masses[k] / total * lever
        reach += float(np.linalg.norm(part))
    span, force = plan.duration.upper, np.sqrt(3) * FORCE
    place = pin.exp3(np.radians(rate) * span * AXIS / np.linalg.norm(AXIS)) @ data.oMf[ring].translation
    gap = float(np.linalg.norm(centre + span * velocity - place))
    return gap - reach - force * span**2 / (2 * total)


def at(solver: PlanSolver, rate: float) -> PlanSolver:
    """Solver at another rate, with which only the start of the motion differs."""
    scene = scene_at(rate)
    problem = dataclasses.replace(solver.problem, fixed=np.concatenate([scene.q, scene.v]))
    return solver.with_first(problem=problem)


def solved(solver: PlanSolver, near: SolveResult) -> tuple[SolveResult | None, dict[str, Any]]:
    """Plan of a rate on the meshes of another one, None without a plan, and its entries of the data."""
    program = solver.program(solver.request(), near.meshes)
    assert near.solution is not None
    warm = dataclasses.replace(near.solution, barrier=max(near.solution.barrier, BARRIER))
    solution = solve(program, warm.w, warm, scale=near.cost, iterations=ITERATIONS)
    row: dict[str, Any] = {"feasible": solution.converged, "iterations": solution.iterations}
    if not solution.converged:
        elastic = ElasticProgram(program, soft_rows(program), near.cost)
        relaxed = solve(elastic, elastic.started(near.solution.w), iterations=RELAXED)
        violation, start = elastic.violation(relaxed.w), relaxed.w[: program.size]
        row |= {"least_violation": violation, "is_minimum": relaxed.converged, "status": solution.status}
        if violation > FEASIBLE:
            return None, row
        solution = solve(program, start, scale=near.cost, iterations=ITERATIONS)
        row["feasible"] = solution.converged
        if not solution.converged:
            return None, row
    return SolveResult((), solution, near.meshes, program.objective(solution.w), None, ""), row


def refined(solver: PlanSolver, near: SolveResult) -> tuple[SolveResult | None, dict[str, Any]]:
    """Plan after refinement and verification, None if it fails, and its entries of the data."""
    request = solver.request(near=near, is_solved=True)
    result = solve_request(solver, request)
    if (fault := failure_message(result)) is not None:
        return None, {"feasible": False, "failure": fault}
    assert result.solution is not None
    assert result.verification is not None
    row = {
        "cost": result.cost,
        "intervals": [mesh.intervals for mesh in result.meshes],
        "followed_error_m": result.verification.followed_error_m,
    }
    return result, row | described(solver, solver.program(request, result.meshes), result.solution)


def described(solver: PlanSolver, program: NonlinearProgram, solution: Solution) -> dict[str, Any]:
    """Slope of the cost, use of each drive's limit, and cost saved by one percent more of a limit.

    The slope of the optimal cost by a fixed unknown, such as the start, is the derivative of the
    Lagrangian; that by a limit is the limit's multiplier.
    """
    assert isinstance(program, PhaseChain)
    jacobian = program.jacobian_pattern.copy()
    jacobian.data = program.jacobian(solution.w)
    by_start = program.gradient(solution.w) + jacobian.T @ solution.multipliers
    nq, nv = program.programs[0].nq, program.programs[0].nv
    driven, first = solver.problem.stage.driven, nq + 2 * nv
    count = len(driven.names)
    used, of_limits = np.zeros(count), np.zeros(count)
    for phase, part in zip(program.programs, program.parted(solution), strict=False):
        drives, held = (
            phase.split(values)[0][:, first : first + count] for values in (part.w, part.bound_multipliers)
        )
        used = np.maximum(used, np.abs(drives).max(axis=0) / driven.limits)
        of_limits += np.abs(held).sum(axis=0) * driven.limits
    return {
        "slope": float(by_start[nq : nq + nv] @ (scene_at(1.0).v - scene_at(0.0).v)),
        "saved_by_percent": dict(zip(driven.names, (0.01 * of_limits).tolist(), strict=True)),
        "used": dict(zip(driven.names, used.tolist(), strict=True)),
    }


def main() -> None:
    """Search the largest rate; write data, figure and its plan."""
    folder = Path(sys.argv[1] if sys.argv[1:] else "out/largest_rate")
    if not (folder / "first" / PLAN_FILE).exists():
        sr.plan(scene_at(FIRST), folder / "first")
    solver = PlanSolver.of(scene_at(FIRST), "auto", motions=RATES)
    near = stored_motion(solver, folder / "first")
    assert near.solution is not None
    near = dataclasses.replace(
        near, cost=solver.program(solver.request(), near.meshes).objective(near.solution.w)
    )
    rows: list[dict[str, Any]] = []
    largest, rate, step = 0.0, FIRST, STEP
    while step > PRECISE * rate:
        begin, shifted = time.process_time(), at(solver, rate)
        plan, row = solved(shifted, near)
        if plan is not None:
            plan, more = refined(shifted, plan)
            row |= more
        if plan is not None:
            largest, near = rate, plan
        else:
            step /= 2
        rows.append({"value": rate} | row | {"processor_s": time.process_time() - begin})
        print(json.dumps(rows[-1]), flush=True)
        rate = largest + step
    data: dict[str, Any] = {"scenario": SCENARIO, "axis": "rate [deg/s]", "rows": rows, "largest": largest}
    data["bound"] = float(brentq(beyond_reach, largest, 2 * largest))
    data |= {"machine": history.machine(), "commit": history.commit()}
    write_text(Path(DATA), json.dumps(data, indent=1) + "\n")
    write_bytes(Path(FIGURE), to_bytes(feasible_range(data), "png"))
    final = PlanSolver.of(scene_at(largest), solver.backend)
    request = final.request(near=near, is_solved=True)
    write(plan_result(final, request, {PLAN: solve_request(final, request)}), folder / "largest")


if __name__ == "__main__":
    main()
