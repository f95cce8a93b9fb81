"""Solver of a planning problem; its requests and results as plain data."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from optim.planning.formulation.formulate import (
    check_weights,
    formulate_phases,
    located_in_phase,
    plan_section,
)
from optim.planning.formulation.link_pairs import Collision, LinkPair, keep_apart, link_pairs
from optim.planning.formulation.path_constraints import avoidance_rows
from optim.planning.formulation.stage import PlanningProblem
from optim.planning.search.feasibility_checks import (
    check_changeable,
    check_joined,
    check_momentum,
    check_reach,
    check_start,
)
from optim.planning.search.reachability import check_posture
from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.drive_jumps import segment_constraints, segment_problems
from optim.planning.transcription.instant_functions import InstantFunctions, build_instants, extended
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion, PhasedMotion
from optim.planning.transcription.phase_chain import Linkage, PhaseChain
from optim.planning.verification.verify import VerificationResult, limit_names
from optim.problem.scene_recipe import BuildRecipe, SceneRecipe
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene

ProgressCallback = Callable[[str], None]

ITERATIONS = 50
"""Typical number of iterations of one solve with its mesh refinement."""
COMPILED = 30_000
"""Number of evaluated instants above which compiling the problem's functions saves time."""


def with_margins(problem: PlanningProblem, margins: Mapping[str, float]) -> PlanningProblem:
    """Problem with tighter limits.

    Args:
        problem: The problem.
        margins: Margin by which a limit is tightened, by its name, in its unit.
    """
    if not margins:
        return problem
    lower, upper = problem.lower.copy(), problem.upper.copy()
    for k, (name, _) in limit_names(problem).items():
        lower[k] += margins.get(name, 0.0)
        upper[k] -= margins.get(name, 0.0)
    path = tuple(
        dataclasses.replace(
            row,
            lower=row.lower + margins.get(row.name, 0.0) / row.scale,
            upper=row.upper - margins.get(row.name, 0.0) / row.scale,
        )
        for row in problem.path
    )
    return dataclasses.replace(problem, lower=lower, upper=upper, path=path)


@dataclass(frozen=True)
class SolverRun:
    """Record of one run of the solver.

    Attributes:
        start, intervals: Number of the initial guess, and number of intervals.
        cost, status, converged: Final cost, the solver's status message, and whether it converged.
        iterations, evaluations_s, seconds: Number of iterations, time in the problem's functions [s] and
            total time [s].
        costs, violations: Cost and maximum constraint violation at each iteration.
    """

    start: int
    intervals: int
    cost: float
    status: str
    converged: bool
    iterations: int
    evaluations_s: float
    seconds: float
    costs: tuple[float, ...]
    violations: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class SolveResult:
    """Result of a solve request.

    Attributes:
        runs: All runs of the solver, in order.
        solution, meshes, cost: The best solution, the mesh of each phase, and its cost; without a solution
            None, the first meshes, and infinity.
        verification: Verification of the solution, if the mesh was refined.
        cause: Reason for the lack of a solution; empty if there is one.
        apart: Pairs of links that collided in an earlier motion and have had a keep-out zone since then.
    """

    runs: tuple[SolverRun, ...]
    solution: Solution | None
    meshes: tuple[Mesh, ...]
    cost: float
    verification: VerificationResult | None
    cause: str
    apart: tuple[Collision, ...] = ()


@dataclass(frozen=True, eq=False)
class SolveRequest:
    """Request to a plan solver.

    Attributes:
        duration: Minimum, maximum and first guess of the duration [s].
        weights: Weights of the cost terms, and of ``time``.
        start: Number of the initial guess, used if there is no motion to start from.
        near: Result of the same solver whose motion is the initial guess.
        is_solved: Whether ``near`` solves this request already, so that only refinement remains.
        refine: Whether the mesh is refined until the verification passes.
        explain: Whether the smallest violation is searched for if there is no solution.
    """

    duration: tuple[float, float, float]
    weights: Mapping[str, float]
    start: int = 0
    near: SolveResult | None = None
    is_solved: bool = False
    refine: bool = True
    explain: bool = True

    @property
    def key(self) -> str:
        """Hash of the request."""
        plain = [self.duration, dict(self.weights), self.start, self.is_solved, self.refine]
        plain += [] if self.explain else [self.explain]
        digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
        if self.near is not None and self.near.solution is not None:
            digest.update(self.near.solution.w.tobytes() + str((self.near.meshes, self.near.apart)).encode())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class SolverPhase:
    """A phase of a plan, ready to be solved.

    Attributes:
        name, plan, problem, instants: Name (empty if the plan names no phases), plan section, problem and
            functions of the phase.
        link: Linkage with the previous phase; None for the first one.
    """

    name: str
    plan: PlanSection
    problem: PlanningProblem
    instants: InstantFunctions
    link: Linkage | None


@dataclass(frozen=True, eq=False)
class PlanSolver:
    """A planning problem ready to be solved, for any range of its duration and any weights.

    Attributes:
        scene, phases, lobatto, backend: The scene, the phases of its plan, the collocation, and the backend
            that evaluates them.
        notify: Callback that receives a short message at each step.
        pairs, apart: Pairs of links for which the plan avoids collisions, and those that have a keep-out zone
            because they collided during the search.
    """

    scene: Scene
    phases: tuple[SolverPhase, ...]
    lobatto: Lobatto
    backend: str
    notify: ProgressCallback = field(default=lambda _: None)
    pairs: tuple[LinkPair, ...] = ()
    apart: tuple[Collision, ...] = ()
    _known: dict[Any, tuple[tuple[BoundedRow, ...], InstantFunctions]] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def of(
        cls,
        scene: Scene,
        backend: str = "auto",
        notify: ProgressCallback = lambda _: None,
        *,
        motions: int = 1,
    ) -> PlanSolver:
        """The plan solver of a scene.

        Args:
            scene: Scene with a ``plan`` section.
            backend: ``auto``, ``compiled`` or ``interpreted``; ``auto`` compiles if the expected number of
                evaluations exceeds :data:`COMPILED`.
            notify: Callback that receives a short message at each step.
            motions: Number of motions to plan, each from all starts.

        Raises:
            ScenarioError: If the plan section is contradictory.
        """
        formulated, section = formulate_phases(scene), plan_section(scene)
        first = formulated[0]
        plan, problem = first.plan, first.problem
        with located_in_phase(section, first.name):
            check_start(problem)
            check_reach(problem, plan, {tip.label: tip for tip in scene.tips})
            check_joined(problem, plan)
        for phase in formulated:
            with located_in_phase(section, phase.name):
                check_momentum(phase.problem, phase.plan)
            if phase.problem.stage.driven.drives_bases:
                break  # what momentum is left behind it nobody knows
        check_weights(section, formulated)
        with located_in_phase(section, first.name):
            check_changeable(problem)
            check_posture(problem)
        intervals = sum(phase.plan.intervals for phase in formulated)
        instants_in_all = motions * plan.starts * intervals * plan.order // 2 * ITERATIONS
        if backend == "auto" and instants_in_all < COMPILED:
            backend = "interpreted"
        notify("building the problem's functions")
        phases = list[SolverPhase]()
        for one in formulated:
            link = Linkage.into(one.problem.stage, one.impact) if phases else None
            instants = build_instants(one.problem, backend)
            phases.append(SolverPhase(one.name, one.plan, one.problem, instants, link))
        lobatto, pairs = Lobatto.of_order(plan.order), tuple(link_pairs(scene))
        return cls(scene, tuple(phases), lobatto, backend, notify, pairs)

    @property
    def plan(self) -> PlanSection:
        """Section of the first phase."""
        return self.phases[0].plan

    @property
    def problem(self) -> PlanningProblem:
        """Problem of the first phase."""
        return self.phases[0].problem

    @property
    def instants(self) -> InstantFunctions:
        """Functions of the first phase."""
        return self.phases[0].instants

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all phases."""
        return tuple(one.name for one in self.phases)

    @property
    def links(self) -> list[Linkage]:
        """Linkages into the phases after the first one."""
        return [one.link for one in self.phases if one.link is not None]

    def with_first(self, **changes: Any) -> PlanSolver:
        """Return a solver with changes of its first phase."""
        first = dataclasses.replace(self.phases[0], **changes)
        return dataclasses.replace(self, phases=(first, *self.phases[1:]))

    def keeping_apart(self, apart: Sequence[Collision]) -> PlanSolver:
        """Solver with a keep-out zone for each of some pairs of links, in this order.

        Only the new rows are differentiated. Pairs of shapes with an existing zone are skipped.

        Args:
            apart: Pairs of links, with the shapes that collided.

        Raises:
            ScenarioError: If shapes, or primitives around them, have no positive distance at the start.
        """
        shapes = {(one.first, one.second, k) for one in self.apart for k in one.only}
        new = [
            dataclasses.replace(one, only=tuple(left))
            for one in apart
            if (left := [k for k in one.only if (one.first, one.second, k) not in shapes])
        ]
        if not new:
            return self
        scene, all_apart = keep_apart(self.scene, new), (*self.apart, *new)
        plans = plan_section(scene).by_phase
        pair_keys = tuple(
            tuple((one.first, one.second, one.only) for one in each) for each in (self.apart, new)
        )

        phases = []
        for one in self.phases:
            key = one.name, *pair_keys
            if key not in self._known:
                rows = tuple(
                    avoidance_rows(one.problem.stage, plans[one.name], plan_section(self.scene).keep_out)
                )
                self._known[key] = rows, extended(one.instants, one.problem, rows)
            rows, instants = self._known[key]
            problem = dataclasses.replace(one.problem, path=(*one.problem.path, *rows))
            phases.append(dataclasses.replace(one, plan=plans[one.name], problem=problem, instants=instants))
        return dataclasses.replace(self, scene=scene, phases=tuple(phases), apart=all_apart)

    @property
    def recipe(self) -> BuildRecipe:
        """Recipe that builds this solver in another process."""
        return BuildRecipe(SceneRecipe.of(self.scene), PlanSolver.of, {"backend": self.backend})

    @cached_property
    def interpreted(self) -> PlanSolver:
        """Solver whose functions CasADi interprets, for the verification."""
        if self.instants.backend == "interpreted":
            return self
        phases = (
            dataclasses.replace(one, instants=build_instants(one.problem, "interpreted"))
            for one in self.phases
        )
        return dataclasses.replace(self, phases=tuple(phases))

    def request(self, **changes: object) -> SolveRequest:
        """Request with the section's duration and weights."""
        request = SolveRequest(self.problem.duration, self.problem.weights)
        return dataclasses.replace(request, **changes)  # type: ignore[arg-type]

    def problem_of(self, request: SolveRequest) -> PlanningProblem:
        """Problem of the first phase, with the duration and weights of a request."""
        return dataclasses.replace(self.problem, duration=request.duration, weights=request.weights)

    def problems_of(self, request: SolveRequest) -> list[PlanningProblem]:
        """Problems of all phases, the first one with the duration and weights of a request."""
        return [self.problem_of(request), *(one.problem for one in self.phases[1:])]

    def meshes(self, intervals: int) -> tuple[Mesh, ...]:
        """Meshes of equal intervals for all phases: ``intervals`` in the first one, others in proportion."""
        shares = (one.plan.intervals / self.plan.intervals for one in self.phases)
        return tuple(Mesh.of(max(1, round(share * intervals))) for share in shares)

    def program(
        self, request: SolveRequest, meshes: Sequence[Mesh], margins: Mapping[str, float] | None = None
    ) -> PhaseChain:
        """Nonlinear program on a mesh of each phase, or of each segment of a single phase.

        Args:
            request, meshes: Request, and the meshes.
            margins: Margins by which limits are tightened, by their names, in their units.
        """
        problems = [with_margins(problem, margins or {}) for problem in self.problems_of(request)]
        if len(self.phases) == 1 and (len(meshes) > 1 or problems[0].magnitudes):
            programs = [
                CollocationProgram(problem, self.instants, self.lobatto, mesh)
                for problem, mesh in zip(segment_problems(problems[0], len(meshes)), meshes, strict=True)
            ]
            joints = [self.joint] * (len(meshes) - 1) if len(meshes) > 1 else []
            return PhaseChain(programs, joints, segment_constraints(programs, problems[0]))
        programs = [
            CollocationProgram(problem, one.instants, self.lobatto, mesh)
            for problem, one, mesh in zip(problems, self.phases, meshes, strict=True)
        ]
        return PhaseChain(programs, self.links)

    @cached_property
    def joint(self) -> Linkage:
        """Linkage of two segments of a phase: the state is continuous."""
        return Linkage.into(self.problem.stage, False)

    def motion(self, request: SolveRequest, result: SolveResult) -> Motion:
        """Motion of a solution in the first phase."""
        return self.phased_motion(request, result).motions[0]

    def phased_motion(self, request: SolveRequest, result: SolveResult) -> PhasedMotion:
        """Motions of a solution in all phases."""
        assert result.solution is not None
        program = self.keeping_apart(result.apart).program(request, result.meshes)
        parts = program.parts(result.solution.w)
        motions = [
            Motion(p.problem, p.lobatto, p.mesh, *p.split(unknowns)[::-1])
            for p, unknowns in zip(program.programs, parts, strict=False)
        ]
        return PhasedMotion(tuple(motions), tuple(parts[len(motions) :]))
