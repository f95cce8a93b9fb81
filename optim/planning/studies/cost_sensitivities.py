"""Cost sensitivities: derivatives of a plan's optimal cost by the design, without replanning.

Where the Lagrangian of cost, constraints and limits is stationary, the derivative of the least cost
by any number of the scenario is that of the Lagrangian at the same unknowns and multipliers (the envelope
theorem). That one is taken by central differences: numbers of a scenario enter it by building the scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.planning.formulation.formulate import formulate
from optim.planning.search.make_plan import PlanSolution
from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import InstantFunctions, build_instants, with_values_of
from optim.planning.transcription.motion import Motion
from spacerobot.arrays import Array
from spacerobot.errors import ScenarioError
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import get
from spacerobot.scene import Scene, build_scene

STEP = 1e-4
"""Of the differences, relative to a number, or of it where that is smaller than one thousandth."""
SMALL = 1e-3
SIDES = ((1, 8.0), (2, -1.0))
"""Steps to both sides and their weights: differences of fourth order."""


def cost_sensitivities(planned: PlanSolution, paths: Sequence[str]) -> dict[str, float]:
    """Derivative of a plan's optimal cost by numbers of its scenario, in the scenario's own units.

    Parameters
    ----------
    planned
        The plan.
    paths
        Dotted paths, such as ``robots.arm.links.link_2.mass`` or ``plan.limits.torque``.

    Returns
    -------
    dict
        By path. To first order; where a limit becomes active or is no longer so, it jumps.

    Raises
    ------
    ScenarioError
        If there is no such number, or the plan has several phases.
    """
    if len(planned.phased_motion.motions) > 1:
        raise ScenarioError(
            "cost sensitivities need a plan of one phase whose drives do not jump",
            source=planned.scene.source,
            where="plan.phases",
        )
    document = to_document(planned.scene.scenario)
    instants = build_instants(planned.motion.problem, "interpreted")
    solution = OptimalPoint(planned.scene, planned.motion, planned.solution, instants)
    found = {}
    for path in paths:
        value = get(document, path)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"found {value!r}, allowed: a number", where=path)
        found[path] = solution.slope({path: value})
    return found


@dataclass(frozen=True, eq=False)
class OptimalPoint:
    """A solution of a planning problem, and what evaluates it.

    Attributes
    ----------
    scene, motion, solution, instants
        The scene, the motion, where the solver ended, and the problem's functions.
    """

    scene: Scene
    motion: Motion
    solution: Solution
    instants: InstantFunctions

    def slope(self, numbers: Mapping[str, float]) -> float:
        """Derivative of the optimal cost by numbers of the scenario that change together.

        Parameters
        ----------
        numbers
            Their values by dotted path; one unit more is one unit more of each.

        Raises
        ------
        ScenarioError
            If the scene cannot be built beside these values.
        """
        step = STEP * max(SMALL, *(abs(value) for value in numbers.values()))
        found = 0.0
        for many, weight in SIDES:
            ahead, behind = (
                self._lagrangian({path: value + side * many * step for path, value in numbers.items()})
                for side in (1, -1)
            )
            found += weight * (ahead - behind)
        return found / (12 * step)

    @cached_property
    def _bounds(self) -> Array:
        """Multipliers of the unknowns' limits; of what is fixed, which the solver leaves out, what makes the
        slope vanish.
        """
        program = CollocationProgram(
            self.motion.problem, self.instants, self.motion.lobatto, self.motion.mesh
        )
        low, high = program.bounds()
        jacobian = program.jacobian_pattern.copy()
        jacobian.data = program.jacobian(self.solution.w)
        slope = program.gradient(self.solution.w) + jacobian.T @ self.solution.multipliers
        return np.where(low == high, -slope, self.solution.bound_multipliers)

    def _lagrangian(self, changes: Mapping[str, float]) -> float:
        """At the unknowns and multipliers, for other numbers; counted from the cost."""
        scene, solution = build_scene(self.scene.scenario, changes, source=self.scene.source), self.solution
        problem = formulate(scene)
        instants = with_values_of(self.instants, problem)
        program = CollocationProgram(problem, instants, self.motion.lobatto, self.motion.mesh)
        held = _pressed(solution.multipliers, program.constraints(solution.w), program.limits())
        return program.objective(solution.w) + held + _pressed(self._bounds, solution.w, program.bounds())


def _pressed(multipliers: Array, values: Array, sides: tuple[Array, Array]) -> float:
    """Multipliers times how far values are beyond the limits that they belong to."""
    limit = np.where(multipliers > 0, sides[1], sides[0])
    held = np.isfinite(limit)
    return float(multipliers[held] @ (values - limit)[held])
