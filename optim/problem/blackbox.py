"""Objectives that are any Python function of a result: no gradients, so for evolutionary methods."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.problem.problem import Evaluation, EvaluationCost, Linearisation
from optim.problem.tuning_problem import DerivedProblem
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.result import Result
from spacerobot.result.assembly import build_result
from spacerobot.rollout import Rollout, build_rollout

ResultObjective = Callable[[Result], float]


@dataclass(frozen=True)
class ResultProblem(DerivedProblem):
    """A tuning problem whose objective Python computes from each result; constraints stay the section's."""

    score: ResultObjective

    @property
    def linear_cost(self) -> EvaluationCost:
        """Zero cost, because derivatives are not available."""
        return EvaluationCost()

    @property
    def fingerprint(self) -> str:
        """The tuning problem's, and the function's name: a changed function needs a new journal folder."""
        name = getattr(self.score, "__qualname__", type(self.score).__qualname__)
        return hashlib.sha256(f"{self.nominal.fingerprint} {name}".encode()).hexdigest()

    def evaluate(self, u: Array) -> Evaluation:
        """One rollout and one result after the other; NaN where a rollout diverged."""
        constraints = self.nominal.evaluate(u).constraints if self.constraint_names else np.empty((len(u), 0))
        variables, scene, scores = self.nominal.variables, self.nominal.scene, np.full(len(u), np.nan)
        for i, point in enumerate(u):
            trajectory = self._rollout.run(variables.as_changes(variables.values(point)))
            if trajectory.status == "completed":
                scores[i] = self.score(build_result(scene, self.nominal.loop, trajectory))
        return Evaluation(scores, constraints)

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Raise an error, because derivatives are not available.

        Raises:
            SpaceRobotError: Always.
        """
        raise SpaceRobotError(f"a function of a result has no gradient (at {u[0].tolist()})")

    @cached_property
    def _rollout(self) -> Rollout:
        simulation = self.nominal.scene.scenario.simulation
        return build_rollout(
            self.nominal.loop,
            duration_s=simulation.duration,
            step_s=self.nominal.rollout.grid.step_s,
            output_step_s=simulation.output_step,
            method=simulation.method,
        )
