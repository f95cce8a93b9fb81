"""Cost sensitivities: derivatives of a plan's optimal cost by the design, without replanning.

At a solution the Lagrangian of cost, constraints and limits is stationary. By the envelope theorem, the
derivative of the optimal cost by a value of the scenario is therefore the partial derivative of the
Lagrangian at fixed unknowns and multipliers. It is computed by central differences, for which the scene is
rebuilt, because scenario values enter when it is built.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.planning.formulation.formulate import formulate_phases
from optim.planning.search.make_plan import PlanSolution
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.drive_jumps import segment_constraints, segment_problems
from optim.planning.transcription.instant_functions import with_values_of
from optim.planning.transcription.phase_chain import PhaseChain
from optim.problem.scenario_numbers import numbers_at
from spacerobot.common.arrays import Array
from spacerobot.scene import Scene, build_scene

STEP = 1e-4
"""Step of the differences, relative to the number or to :data:`SMALL`, whichever is larger."""
SMALL = 1e-3
SIDES = ((1, 8.0), (2, -1.0))
"""Distances of the two-sided differences in steps, and their weights: a fourth-order formula."""


def cost_sensitivities(planned: PlanSolution, paths: Sequence[str]) -> dict[str, float]:
    """Derivatives of a plan's optimal cost by values of its scenario, in the scenario's own units.

    Args:
        planned: The plan.
        paths: Dotted paths, such as ``robots.arm.links.link_2.mass`` or ``plan.limits.torque``.

    Returns:
        dict: Derivative by path. It jumps at values where a limit becomes active or inactive.

    Raises:
        ScenarioError: If a path leads to no number.
    """
    numbers = numbers_at(planned.scene, paths)
    solver = PlanSolver.of(planned.scene, "interpreted")
    program = solver.program(solver.request(), planned.phased_motion.meshes)
    solution = OptimalPoint(planned.scene, program, planned.solution)
    return {path: solution.slope({path: value}) for path, value in numbers.items()}


@dataclass(frozen=True, eq=False)
class OptimalPoint:
    """A solution of a planning problem with its scene and program.

    Attributes:
        scene, program, solution: The scene, its program on the meshes of the solution, and the solver's last
            iterate.
    """

    scene: Scene
    program: PhaseChain
    solution: Solution

    def slope(self, numbers: Mapping[str, float], rates: Mapping[str, float] | None = None) -> float:
        """Derivative of the optimal cost by a parameter that changes several scenario values.

        Args:
            numbers: Scenario values by dotted path.
            rates: Change of each value per unit of the parameter; one if not given.

        Raises:
            ScenarioError: If the scene cannot be built at neighbouring values.
        """
        step = STEP * max(SMALL, *(abs(value) for value in numbers.values()))
        derivative = 0.0
        for many, weight in SIDES:
            ahead, behind = (
                self._lagrangian(
                    {
                        path: value + side * many * step * (1.0 if rates is None else rates[path])
                        for path, value in numbers.items()
                    }
                )
                for side in (1, -1)
            )
            derivative += weight * (ahead - behind)
        return derivative / (12 * step)

    @cached_property
    def _bounds(self) -> Array:
        """Multipliers of the unknowns' bounds.

        The solver omits those of fixed unknowns; they are set so that the Lagrangian's gradient vanishes.
        """
        program = self.program
        low, high = program.bounds()
        jacobian = program.jacobian_pattern.copy()
        jacobian.data = program.jacobian(self.solution.w)
        slope = program.gradient(self.solution.w) + jacobian.T @ self.solution.multipliers
        return np.where(low == high, -slope, self.solution.bound_multipliers)

    def _lagrangian(self, changes: Mapping[str, float]) -> float:
        """Lagrangian, in units of the cost, for changed scenario values at fixed unknowns and multipliers."""
        scene, solution = build_scene(self.scene.scenario, changes, source=self.scene.source), self.solution
        # program for the changed values on the same meshes; it is only evaluated
        phases, before, links = formulate_phases(scene), self.program.programs, self.program.links
        problems, segments = [phase.problem for phase in phases], before[0].problem.linear_drives
        if segments:
            problems = segment_problems(problems[0], len(before))
        programs = [
            CollocationProgram(
                problem, with_values_of(collocation.instants, problem), collocation.lobatto, collocation.mesh
            )
            for problem, collocation in zip(problems, before, strict=True)
        ]
        if segments:
            program = PhaseChain(programs, links, segment_constraints(programs, phases[0].problem))
        else:
            joined = zip(links, phases[1:], strict=True)
            valued = [link.with_values_of(one.problem.stage, one.impact) for link, one in joined]
            program = PhaseChain(programs, valued)
        held = _pressed(solution.multipliers, program.constraints(solution.w), program.limits())
        return program.objective(solution.w) + held + _pressed(self._bounds, solution.w, program.bounds())


def _pressed(multipliers: Array, values: Array, sides: tuple[Array, Array]) -> float:
    """Sum of multipliers times the excess of values over the limits that the multipliers belong to."""
    limit = np.where(multipliers > 0, sides[1], sides[0])
    held = np.isfinite(limit)
    return float(multipliers[held] @ (values - limit)[held])
