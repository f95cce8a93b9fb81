"""Formulation of a tuning problem: variables, terms, and the rollout that gives them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from optim.problem.objectives import OBJECTIVE, ObjectiveTerms
from optim.problem.problem import Form
from optim.problem.scene_recipe import tuning_of
from optim.problem.variables import Variables
from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.rollout import Rollout, build_rollout
from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions
from spacerobot.scene import Scene


@dataclass(frozen=True)
class Formulation:
    """A tuning problem: a closed loop, its design variables, and the measures of its rollouts.

    Attributes:
        scene: Scene with the changes of its tuning section.
        loop: Closed loop before parameters are tied to variables.
        variables: The design variables.
        terms: Objective and constraints.
        rollout: Rollout, whose parameters are the variables by name, then all other numbers by dotted path.
    """

    scene: Scene
    loop: ClosedLoop
    variables: Variables
    terms: ObjectiveTerms
    rollout: Rollout

    def __repr__(self) -> str:
        """Scenario and variables, in one line."""
        return f"<{type(self).__name__} of {self.scene.scenario.name}: {', '.join(self.variables.names)}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return self.variables.names

    @property
    def start(self) -> Array:
        """The scenario's own values in the unit cube, (k,)."""
        return np.clip(self.variables.unit(self.variables.start), 0.0, 1.0)

    @property
    def form(self) -> Form:
        """Form of the objective: smooth, a sum of squares or a maximum."""
        return self.terms.form

    @cached_property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the components of constrained measures, and of required margins."""
        sizes, margins = self.terms.measures.sizes, self.terms.margins
        named = tuple(f"{name}.{i}" for name in self.terms.limits for i in range(sizes[name]))
        return named if margins is None else (*named, *margins.names)

    @cached_property
    def objective_slope(self) -> ca.Function:
        """(r, p) -> derivative of the objective with respect to the measures r."""
        objective = self.rollout.kernel.functions["objective"]
        r = ca.SX.sym("r", objective.numel_in(0))
        p = ca.SX.sym("p", objective.numel_in(1))
        row = self.rollout.kernel.costs.index(OBJECTIVE)
        return ca.Function("slope", [r, p], [ca.densify(ca.jacobian(objective(r, p)[row], r))])


def rollout_of(scene: Scene, loop: ClosedLoopFunctions, terms: ObjectiveTerms) -> Rollout:
    """Rollout of a closed loop with the step of the scene's tuning section and the problem's measures.

    Args:
        scene: Scene with the duration, the method and the step.
        loop: Closed loop of the scene, with or without tied parameters.
        terms: Measures and costs of the problem.
    """
    simulation = scene.scenario.simulation
    return build_rollout(
        loop,
        duration_s=simulation.duration,
        step_s=tuning_of(scene).step,
        method=simulation.method,
        measures=terms.measures,
        many=True,
    )
