"""Probability that a simulation exceeds a limit, however rare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from optim.json_result import JsonResult
from optim.reliability.design_points import find_design_points
from optim.reliability.estimator import ProbabilityEstimator, SamplingEffort
from optim.reliability.limit_state import CountedLimitState, build_limit_state
from spacerobot.notebook import html_table
from spacerobot.registry import ESTIMATORS
from spacerobot.scene import Scene

STARTS = 8
"""Starts of the search for design points: the origin, and others drawn at random."""
LEAST = 1000  # rollouts of the estimator
NORMAL = 1.96  # quantile of the 95 % interval


@dataclass(frozen=True)
class FailureProbability(JsonResult):
    """Probability that a quantity exceeds its limit.

    Attributes
    ----------
    quantity, unit, limit
        What must not exceed how much.
    method
        The estimator.
    probability, variation
        The estimate and its coefficient of variation; infinite where no failure was found.
    rollouts, gradients
        Simulations without and with a gradient that were spent.
    failures
        The most probable failures, each with its reliability index ``beta``, the ``parameters`` there and
        their ``importance``, the squared cosines of the direction: shares of the distance that each takes.
    """

    key: ClassVar[str] = "failure_probability"

    quantity: str
    unit: str
    limit: float
    method: str
    probability: float
    variation: float
    rollouts: int
    gradients: int
    failures: tuple[Mapping[str, Any], ...]

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval by the lognormal distribution."""
        factor = np.exp(NORMAL * min(self.variation, 100.0))
        return self.probability / factor, min(1.0, self.probability * factor)

    def rows(self) -> list[tuple[str, str]]:
        """Names and numbers, as text."""
        low, high = self.interval
        value = f"{self.probability:.3g} (95 % interval {low:.2g} .. {high:.2g})"
        spent = f"{self.rollouts}, and {self.gradients} with a gradient"
        return [
            (
                f"P({self.quantity} > {self.limit:g} {self.unit})",
                value if self.probability else "no failure was found: raise the budget, or lower the limit",
            ),
            ("coefficient of variation", f"{100 * self.variation:.2g} %" if self.probability else "-"),
            ("method", self.method),
            ("rollouts", spent),
        ]

    @classmethod
    def of_fields(cls, found: dict[str, Any]) -> FailureProbability:
        """The result with the fields of a file."""
        variation = np.inf if found["variation"] is None else found["variation"]
        return cls(**found | {"failures": tuple(found["failures"]), "variation": variation})

    def __repr__(self) -> str:
        """The probability and its coefficient of variation, in one line."""
        return (
            f"<FailureProbability {self.quantity} > {self.limit:g}: {self.probability:.3g}, "
            f"c.o.v. {100 * self.variation:.2g} %>"
        )

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return html_table("Failure probability", self.rows())


def failure_probability(
    scene: Scene,
    quantity: str | None = None,
    limit: float | None = None,
    *,
    method: str = "importance",
    effort: SamplingEffort | None = None,
    threads: int | None = None,
) -> FailureProbability:
    """Probability that a quantity exceeds a limit, over the uncertain parameters of a scene's campaign.

    The most probable failures are searched for by exact gradients from several starts; the estimators sample
    about them or along them. A rollout that diverges counts as a failure.

    Parameters
    ----------
    scene
        A scene whose scenario has a ``campaign`` section.
    quantity, limit
        What must not exceed how much, in its unit; those of ``campaign.limits`` if None.
    method
        ``importance``, ``line`` or ``subset``.
    effort
        How accurate it shall be, and what may be spent.
    threads
        One for each usable core if None; the numbers do not depend on it.

    Raises
    ------
    ScenarioError
        If the section is missing or does not fit; see :func:`.build_limit_state`.
    SpaceRobotError
        If there is no such method or quantity.
    """
    estimator: ProbabilityEstimator = ESTIMATORS.find(method)
    state = build_limit_state(scene, quantity, limit, threads=threads)
    counted, effort = CountedLimitState(state), effort or SamplingEffort()
    points = []
    if estimator.needs_design_points:
        k = len(state.names)
        starts = np.vstack([np.zeros(k), effort.rng.standard_normal((STARTS - 1, k))])
        points = find_design_points(counted, starts)
        effort = replace(effort, budget=max(effort.budget - counted.rollouts, LEAST))
    found, names = estimator.estimate(counted, points, effort), state.names
    failures = [
        {
            "beta": point.beta,
            "parameters": dict(zip(names, map(float, state.draws(point.z[None])[0][0]), strict=True)),
            "importance": dict(zip(names, map(float, point.direction**2), strict=True)),
        }
        for point in points
    ]
    return FailureProbability(
        state.quantity.name,
        state.unit,
        state.limit,
        method,
        found.probability,
        found.variation,
        counted.rollouts,
        counted.gradient_rollouts,
        tuple(failures),
    )
