"""Envisat's largest rate: ``python -m benchmarks.largest_rate [FOLDER]``.

The tumbling of ``envisat`` about the intermediate axis is raised from 5 deg/s, each rate planned from the
plan of the rate below it on the same meshes, with steps that are halved where no plan is found, until
feasible and infeasible rates are ``PRECISE`` apart. At an infeasible rate the elastic program gives the
least violation of goals and limits; it is a local minimum, so that it is evidence and no proof. The greatest
feasible rate is refined and verified, and kept in the folder, ``out/largest_rate`` if none is named. Data are
written to ``docs/data``, the figure to ``docs/images``.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import spacerobot as sr
from benchmarks import history
from optim.planning.output.plan_folder import write
from optim.planning.search.failure_messages import soft_rows
from optim.planning.search.make_plan import PLAN, failure_message, plan_result
from optim.planning.search.plan_solver import PlanSolver, SolveResult
from optim.planning.search.solve_request import solve_request
from optim.planning.search.warm_start import FILE as PLAN_FILE
from optim.planning.search.warm_start import stored_motion
from optim.planning.solver.elastic import ElasticProgram
from optim.planning.solver.ipopt import solve
from optim.planning.studies.cost_sensitivities import OptimalPoint
from optim.planning.transcription.phase_chain import PhaseChain
from spacerobot.files import write_bytes, write_text
from spacerobot.scene import Scene
from viz.figures.feasible_range import feasible_range
from viz.figures.style import to_bytes

AXIS, PLACE = np.array([0.00522422, 0.99701949, -0.07697305]), np.array([7.2, 0.0, 0.4])
"""Intermediate axis of Envisat, and where the servicer begins [m], both in Envisat's axes."""
FIRST, STEP, PRECISE = 5.0, 1.0, 0.01
"""First rate and first step [deg/s], and the step, relative to the rate, at which the search ends."""
ITERATIONS, RELAXED = 150, 250
FEASIBLE = 1e-7
SCENARIO, DATA, FIGURE = "envisat", "docs/data/envisat_rates.json", "docs/images/envisat_rates.png"


@dataclass(frozen=True, eq=False)
class PlannedRate:
    """A rate that a plan was found for."""

    rate: float
    scene: Scene
    solver: PlanSolver
    result: SolveResult


def directions() -> dict[str, float]:
    """Change of each number of the scenario with the rate, per deg/s: both bodies turn together."""
    found = dict[str, float]()
    for path, vector in (
        ("target.base.spin_deg", AXIS),
        ("robots.servicer.base.spin_deg", AXIS),
        ("robots.servicer.base.velocity", np.cross(np.radians(AXIS), PLACE)),
    ):
        found |= {f"{path}.{k}": float(value) for k, value in enumerate(vector)}
    return found


def scene_at(rate: float) -> Scene:
    """The scenario at a rate [deg/s]."""
    return sr.load_scene(SCENARIO, {path: rate * each for path, each in directions().items()})


def solved(rate: float, near: SolveResult) -> tuple[PlannedRate | None, dict[str, Any]]:
    """Plan of a rate on the meshes of another, if there is one, and a row of the data."""
    scene = scene_at(rate)
    solver = PlanSolver.of(scene, "interpreted")
    program = solver.program(solver.request(), near.meshes)
    assert near.solution is not None
    found = solve(program, near.solution.w, near.solution, scale=near.cost, iterations=ITERATIONS)
    row: dict[str, Any] = {"value": rate, "iterations": found.iterations, "feasible": found.converged}
    if not found.converged:
        elastic = ElasticProgram(program, soft_rows(program), near.cost)
        relaxed = solve(elastic, elastic.started(found.w), iterations=RELAXED)
        violation = elastic.violation(relaxed.w)
        row |= {"least_violation": violation, "converged": relaxed.converged, "status": found.status}
        if violation > FEASIBLE or not relaxed.converged:
            return None, row
        found = solve(program, relaxed.w[: program.size], scale=near.cost, iterations=2 * ITERATIONS)
        row |= {"feasible": found.converged, "status": found.status}
        if not found.converged:
            return None, row
    cost = program.objective(found.w)
    result = SolveResult((), found, near.meshes, cost, None, "")
    return PlannedRate(rate, scene, solver, result), row | {"cost": cost}


def described(planned: PlannedRate) -> dict[str, Any]:
    """Slope of the cost, how near each drive comes to its limit, and what one percent of all limits saves."""
    solver, result, rates = planned.solver, planned.result, directions()
    program = solver.program(solver.request(), result.meshes)
    solution = result.solution
    assert solution is not None
    assert isinstance(program, PhaseChain)
    motions = solver.phased_motion(solver.request(), result).motions
    driven, first = solver.problem.stage.driven, program.programs[0].nx + program.programs[0].nv
    of_limits = np.zeros(len(driven.names))
    for own, part in zip(program.programs, program.parted(solution), strict=False):
        by_point, _ = own.split(part.bound_multipliers)
        of_limits += np.abs(by_point[:, first : first + len(of_limits)]).sum(axis=0)
    used = np.max([np.abs(motion.u).max(axis=0) for motion in motions], axis=0) / driven.limits
    point = OptimalPoint(planned.scene, program, solution)
    return {
        "slope": point.slope({path: planned.rate * each for path, each in rates.items()}, rates),
        "saved_by_percent": dict(zip(driven.names, (0.01 * of_limits * driven.limits).tolist(), strict=True)),
        "used": dict(zip(driven.names, used.tolist(), strict=True)),
    }


def verified(planned: PlannedRate, folder: Path) -> dict[str, Any]:
    """Plan of the rate, refined and verified by replay, in a folder; why there is none."""
    request = planned.solver.request(near=planned.result, is_solved=True)
    result = solve_request(planned.solver, request)
    if (fault := failure_message(result)) is not None:
        return {"verified": False, "failure": fault}
    plan = plan_result(planned.solver, request, {PLAN: result})
    write(plan, folder)
    return {"verified": True, "cost": plan.cost}


def main() -> None:
    """Search, verify, and write data and figure."""
    folder, rows = Path(sys.argv[1] if sys.argv[1:] else "out/largest_rate"), []
    if not (folder / "first" / PLAN_FILE).exists():
        sr.plan(scene_at(FIRST), folder / "first")
    solver = PlanSolver.of(scene_at(FIRST), "interpreted")
    near = stored_motion(solver, folder / "first")
    assert near.solution is not None
    cost = solver.program(solver.request(), near.meshes).objective(near.solution.w)
    near = dataclasses.replace(near, cost=cost)
    rate, step, best = FIRST, STEP, None
    while step > PRECISE * rate:
        begun = time.process_time()
        found, row = solved(rate, near)
        if found is not None:
            row, best, near = row | described(found), found, found.result
        else:
            step /= 2
        row["processor_s"] = time.process_time() - begun
        print(
            json.dumps({key: value for key, value in row.items() if key not in ("used", "saved_by_percent")}),
            flush=True,
        )
        rows.append(row)
        rate = (FIRST if best is None else best.rate) + step
    assert best is not None
    data = {
        "scenario": SCENARIO,
        "axis": "rate [deg/s]",
        "rows": rows,
        "largest": best.rate,
        **verified(best, folder / "largest"),
    }
    data |= {"machine": history.machine(), "commit": history.commit()}
    write_text(Path(DATA), json.dumps(data, indent=1) + "\n")
    write_bytes(Path(FIGURE), to_bytes(feasible_range(data), "png"))


if __name__ == "__main__":
    main()
