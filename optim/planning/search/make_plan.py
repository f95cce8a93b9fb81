"""Planning from formulation to verification: searches from several starts, refinement, verification."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial

from optim.planning.search.candidates import Candidate, best_candidate
from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult, SolverRun
from optim.planning.search.solve_tasks import SolveTask, run_tasks
from optim.planning.search.warm_start import stored_motion
from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.initial_guess import arrival_durations
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.verification.verify import VerificationResult
from spacerobot.common.errors import NoPlanError
from spacerobot.common.files import StrPath
from spacerobot.scene import Scene

Progress = Callable[[str], None]
PLAN = "plan"
"""Name of the task whose result is the plan."""


@dataclass(frozen=True, eq=False)
class PlanSolution:
    """A planned trajectory with its cost, the solver's runs and its verification.

    Attributes:
        scene, phased_motion: The scene, and its motion in one or several phases.
        names: Names of the scenario's phases; one empty name if the plan names no phases.
        cost, terms: Cost, and its terms by name.
        runs: All runs of the solver, in order.
        solution: Last iterate of the solver, with its multipliers.
        verification: Verification of the motion.
        backend: Evaluation of the problem's functions: ``compiled`` or ``interpreted``.
        candidates: Outcomes of all candidates if the plan had a choice; ``scene`` has the chosen values.
        pairs, kept_apart: Number of pairs of links checked for collisions, and the names of those with a
            keep-out zone, which was added to the scene after a collision.
    """

    scene: Scene
    phased_motion: PhasedMotion
    names: tuple[str, ...]
    cost: float
    terms: Mapping[str, float]
    runs: tuple[SolverRun, ...]
    solution: Solution
    verification: VerificationResult
    backend: str
    candidates: tuple[Candidate, ...] = ()
    pairs: int = 0
    kept_apart: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        """Scenario, duration and cost, in one line."""
        duration = f"{self.phased_motion.duration_s:.4g} s"
        return f"<PlanSolution {self.scene.scenario.name}: {duration}, cost {self.cost:.6g}, {self.backend}>"

    @property
    def motion(self) -> Motion:
        """The motion in the first phase."""
        return self.phased_motion.motions[0]


def make_plan(
    scene: Scene,
    *,
    backend: str = "auto",
    progress: Progress | None = None,
    folder: StrPath | None = None,
    dask: str | None = None,
    warm_start: StrPath | None = None,
) -> PlanSolution:
    """Solve the trajectory optimisation problem of a scene's ``plan`` section.

    Args:
        scene: The scene.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        progress: Called with a short message before each step that may take long.
        folder: Folder of finished searches, from which an interrupted plan resumes; None stores nothing.
        dask: Address of a cluster, as for :func:`optim.workers.cluster.connect`, whose workers search from
            several starts in parallel; this process alone if None. Only computing times depend on it.
        warm_start: Folder of a plan, or its ``plan.nc``. Its motion is the first start's initial guess, with
            its multipliers if they fit; see :func:`optim.planning.search.warm_start.stored_motion`.

    Raises:
        ScenarioError: If the section is contradictory, or ``warm_start`` is not a plan of such a scene.
        NoPlanError: If no motion is found, or it fails the verification; with the reason.
    """
    folder = None if folder is None else Path(folder)

    def of(each: Scene, words: str) -> tuple[float, PlanSolution]:
        """Cost and plan of one candidate."""
        notify = progress or (lambda _: None)
        solver = PlanSolver.of(each, backend, (lambda text: notify(f"{words}: {text}")) if words else notify)
        near = None if warm_start is None else stored_motion(solver, Path(warm_start))
        requests, faults = arrival_requests(solver, solver.request(near=near)), list[str]()
        for name, request in requests.items():
            results = run_tasks(solver, plan_tasks(solver, request, name), folder, dask)
            fault = failure_message(results[name], solver.plan.starts)
            if fault is None:
                plan = plan_result(solver, request, results, name)
                return plan.cost, plan
            faults.append(fault if len(requests) == 1 else f"{request.duration[0]:.4g} s: {fault}")
        raise NoPlanError("; ".join(faults), source=scene.source, where="plan")

    best, candidates = best_candidate(scene, of)
    return dataclasses.replace(best, candidates=candidates)


def arrival_requests(solver: PlanSolver, request: SolveRequest) -> dict[str, SolveRequest]:
    """Requests by the names of their tasks, one for each fixed duration, in the order of trial.

    Args:
        solver: The problem.
        request: Request with the range of the duration; it is the only request if that is free or fixed.
    """
    span = solver.plan.duration
    if span is None or not span.arrivals or span.lower == span.upper:
        return {PLAN: request}
    problem = solver.problem_of(request)
    durations = arrival_durations(problem, solver.lobatto, span.arrivals)
    return {
        f"{PLAN}, arrival {k + 1}": dataclasses.replace(
            request, duration=(time, time, time), explain=k + 1 == len(durations)
        )
        for k, time in enumerate(durations)
    }


def plan_tasks(solver: PlanSolver, request: SolveRequest, name: str = PLAN) -> dict[str, SolveTask]:
    """Tasks that search from every start on the first mesh; the task ``name`` refines the best result.

    If the request has a motion to start from, the first start uses it.
    """
    starts = tuple(f"{name}, start {k + 1}" for k in range(solver.plan.starts))
    tasks = {
        start: SolveTask(
            lambda _, k=k: dataclasses.replace(  # type: ignore[misc]
                request, start=k, near=None if k else request.near, refine=False
            )
        )
        for k, start in enumerate(starts)
    }

    def best(by_name: Mapping[str, SolveResult]) -> SolveRequest:
        """Request that refines the best of the starts' results."""
        k = min(range(len(starts)), key=lambda k: by_name[starts[k]].cost)
        return dataclasses.replace(request, start=k, near=by_name[starts[k]], is_solved=True)

    return tasks | {name: SolveTask(best, starts)}


def failure_message(result: SolveResult, starts: int = 1) -> str | None:
    """Reason for the lack of a plan; None if there is one."""
    names = ", ".join(dict.fromkeys(f"{one.first} and {one.second}" for one in result.apart))
    avoidance = f"; `collision_avoidance` keeps apart {names}" if names else ""
    if result.solution is None:
        many = f" from {starts} starts" if starts > 1 else ""
        # arrivals other than the last one are not explained by the smallest violation
        solver_status = (
            f"the solver ended with {result.runs[-1].status!r}" if result.runs else "no initial guess"
        )
        return f"no plan was found{many}: {result.cause or solver_status}{avoidance}"
    assert result.verification is not None
    faults = result.verification.failures()
    if faults and result.cause:
        faults.append(result.cause)
    return f"the plan is refused: {'; '.join(faults)}{avoidance}" if faults else None


def plan_result(
    solver: PlanSolver, request: SolveRequest, results: Mapping[str, SolveResult], name: str = PLAN
) -> PlanSolution:
    """Plan from the result of a task."""
    result = results[name]
    assert result.verification is not None
    assert result.solution is not None
    phased_motion = solver.phased_motion(request, result)
    terms = dict[str, float]()
    for motion in phased_motion.motions:
        for term, value in integrals(motion).items():
            terms[term] = terms.get(term, 0.0) + motion.problem.weights[term] * value
    solver = solver.keeping_apart(result.apart)
    runs = [one for task, a in results.items() if task.startswith(f"{name}, start") for one in a.runs]
    return PlanSolution(
        solver.scene,
        phased_motion,
        solver.names if len(solver.phases) > 1 else solver.names * len(phased_motion.motions),
        sum(terms.values()),
        terms,
        (*runs, *result.runs),
        result.solution,
        result.verification,
        solver.instants.backend,
        pairs=len(solver.pairs),
        kept_apart=tuple(dict.fromkeys((one.first, one.second) for one in result.apart)),
    )


def integrals(motion: Motion) -> dict[str, float]:
    """Cost terms of a motion without weights: integrals, terminal costs, and the duration if it has a weight.

    Magnitudes of forces are integrated exactly from the polynomials between the points.
    """
    problem = motion.problem
    totals: dict[str, float] = {}
    weights = motion.lobatto.quadrature(motion.mesh)
    for name, term in problem.terms.items():
        values = ca.Function("term", [problem.stage.z], [ca.densify(term)])(motion.z.T).full()
        totals[name] = float(weights @ np.array(values).ravel()) * motion.duration_s
    for name, forces in problem.magnitudes.items():  # whose quadrature misses changes of sign between points
        # forces are polynomials in each interval: between their roots the magnitude's integral is exact
        lobatto, variation = motion.lobatto, 0.0
        drive = np.array(ca.Function("forces", [problem.stage.z], [ca.densify(forces)])(motion.z.T).full())
        for n, width in enumerate(motion.mesh.widths):
            inside = slice(n * (lobatto.points - 1), (n + 1) * (lobatto.points - 1) + 1)
            for values in drive[:, inside]:
                force = Polynomial(np.transpose(lobatto.basis) @ values)
                roots = force.roots()
                ends = np.unique([*np.clip(roots[np.abs(roots.imag) < 1e-09].real, 0, 1).tolist(), 0.0, 1.0])
                variation += width * float(np.abs(np.diff(force.integ()(ends))).sum())
        totals[name] = float(variation * motion.duration_s)
    for name, end in problem.ends.items():
        totals[name] = float(ca.Function("end", [problem.stage.z], [end])(motion.z[-1]))
    return totals | ({"time": motion.duration_s} if problem.time_weight else {})
