"""Objectives that are any Python function of a result: no gradients, so for evolutionary methods."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.problem.problem import Evaluation, EvaluationCost, Linearisation, OptimisationProblem
from optim.problem.tuning_problem import TuningProblem
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.result import Result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Rollout, build_rollout

ResultObjective = Callable[[Result], float]


@dataclass(frozen=True)
class ResultProblem(OptimisationProblem):
    """A tuning problem whose objective Python computes from each result; constraints stay the section's."""

    problem: TuningProblem
    score: ResultObjective

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return self.problem.names

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The tuning section's."""
        return self.problem.constraint_names

    @property
    def start(self) -> Array:
        """The scenario's own values."""
        return self.problem.start

    @property
    def linear_cost(self) -> EvaluationCost:
        """No cost, because there is no gradient."""
        return EvaluationCost()

    @property
    def fingerprint(self) -> str:
        """The tuning problem's, and the function's name: a changed function needs a new journal folder."""
        name = getattr(self.score, "__qualname__", type(self.score).__qualname__)
        return hashlib.sha256(f"{self.problem.fingerprint} {name}".encode()).hexdigest()

    def evaluate(self, u: Array) -> Evaluation:
        """One rollout and one result after the other; NaN where a rollout diverged."""
        constraints = self.problem.evaluate(u).constraints if self.constraint_names else np.empty((len(u), 0))
        variables, scene, scores = self.problem.variables, self.problem.scene, np.full(len(u), np.nan)
        for i, point in enumerate(u):
            trajectory = self._rollout.run(variables.as_changes(variables.values(point)))
            if trajectory.status == "completed":
                data = build_dataset(scene, trajectory, self.problem.loop)
                result = Result(scene.scenario, data, build_summary(scene, data, trajectory, {}, {}))
                scores[i] = self.score(result)
        return Evaluation(scores, constraints)

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Refuse derivatives, because there is no gradient.

        Raises:
            SpaceRobotError: Always.
        """
        raise SpaceRobotError(f"a function of a result has no gradient (at {u[0].tolist()})")

    @cached_property
    def _rollout(self) -> Rollout:
        simulation = self.problem.scene.scenario.simulation
        return build_rollout(
            self.problem.loop,
            duration_s=simulation.duration,
            step_s=self.problem.rollout.grid.step_s,
            output_step_s=simulation.output_step,
            method=simulation.method,
        )
