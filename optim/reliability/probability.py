"""Probability that a simulation exceeds a limit, however rare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from optim.json_files import JsonResult
from optim.reliability.design_points import DesignPointSearch, search_design_points
from optim.reliability.estimator import ProbabilityEstimate, ProbabilityEstimator, SamplingEffort
from optim.reliability.limit_state import CountedLimitState, build_limit_state
from spacerobot.common.files import StrPath
from spacerobot.common.registry import ESTIMATORS
from spacerobot.common.tables import Content, Table
from spacerobot.scene import Scene, to_scene

LEAST = 1000  # rollouts of the estimator
NORMAL = 1.96  # quantile of the 95 % interval
UNSURE = 0.15
"""Probability that another start finds a new design point, above which a warning is given."""
MOST_FAILURES = 3
"""Number of most probable failures that are presented."""
HEAVY = 0.2
"""Share of the estimate that one sample contributes, above which a warning says so."""


@dataclass(frozen=True)
class MostProbableFailure:
    """A design point: the point of a limit surface locally nearest to the medians.

    Attributes:
        beta: Reliability index: distance from the medians in standard deviations, negative where the medians
            fail.
        parameters: Values of the uncertain parameters by name.
        importance: Squared direction cosines by name: the share of the squared distance along each parameter.
    """

    beta: float
    parameters: Mapping[str, float]
    importance: Mapping[str, float]


@dataclass(frozen=True)
class FailureProbability(JsonResult):
    """Probability that a quantity exceeds its limit.

    Attributes:
        quantity, unit, limit: Name, unit and limit of the quantity.
        method: The estimator.
        probability, variation: The estimate and its coefficient of variation; infinite where no failure was
            found.
        rollouts, gradients: Simulations without and with a gradient that were spent.
        failures: The most probable failures, in the order of their reliability index ``beta``, with
            ``parameters`` and ``importance``; none with ``subset``, which does not search for them.
        starts: Starts of the search for them, drawn at random.
        undiscovered: Upper 95 % confidence limit of the probability that another start finds a new most
            probable failure; None without a search (``subset``).
        warnings: Reasons why the interval may be too narrow.
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
    failures: tuple[MostProbableFailure, ...]
    starts: int = 0
    undiscovered: float | None = None
    warnings: tuple[str, ...] = ()

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of the 95 % confidence interval; the estimate is taken as lognormally distributed."""
        factor = np.exp(NORMAL * min(self.variation, 100.0))
        return self.probability / factor, min(1.0, self.probability * factor)

    def verdict(self) -> list[str]:
        """Probability with its confidence interval."""
        if not self.probability:
            return []
        low, high = self.interval
        return [
            f"{self.quantity} exceeds {self.limit:g} {self.unit} with a probability of "
            f"{self.probability:.3g}; the 95 % confidence interval is {low:.2g} to {high:.2g}."
        ]

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
            *self._search_row(),
            *(("warning", warning) for warning in self.warnings),
        ]

    def _search_row(self) -> list[tuple[str, str]]:
        """Number of most probable failures, and confidence that none is missing."""
        if self.undiscovered is None:
            return []
        value = (
            f"{len(self.failures)} from {self.starts} starts; another start finds a new one with a "
            f"probability of at most {100 * self.undiscovered:.3g} % (95 % confidence)"
        )
        return [("most probable failures", value)]

    @classmethod
    def of_fields(cls, fields: dict[str, Any]) -> FailureProbability:
        """The result with the fields of a file."""
        variation = np.inf if fields["variation"] is None else fields["variation"]
        lists = {
            "failures": tuple(MostProbableFailure(**failure) for failure in fields["failures"]),
            "warnings": tuple(fields.get("warnings", ())),
        }
        return cls(**fields | lists | {"variation": variation})

    def __repr__(self) -> str:
        """The probability and its coefficient of variation, in one line."""
        return (
            f"<FailureProbability {self.quantity} > {self.limit:g}: {self.probability:.3g}, "
            f"c.o.v. {100 * self.variation:.2g} %>"
        )

    def content(self) -> list[Content]:
        """Probability with its interval, and the most probable failures."""
        content: list[Content] = [Table.of_pairs("failure probability", self.rows())]
        for failure in self.failures[:MOST_FAILURES]:
            content.append(
                f"A most probable failure, {failure.beta:.3g} standard deviations from the medians:"
            )
            rows = [
                (name, f"{value:.6g}", f"{100 * failure.importance[name]:.2g} %")
                for name, value in failure.parameters.items()
            ]
            content.append(Table(None, ("parameter", "there", "importance"), rows))
        return content


def failure_probability(
    scene: Scene | StrPath,
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

    Args:
        scene: A scene whose scenario has a ``campaign`` section, or the scenario's name or file.
        quantity, limit: Quantity and its limit, in its unit; those of ``campaign.limits`` if None.
        method: ``importance``, ``line`` or ``subset``.
        effort: Required accuracy, and budget.
        threads: Number of threads; one for each usable core if None; the numbers do not depend on it.

    Raises:
        ScenarioError: If the section is missing or does not fit; see :func:`.build_limit_state`.
        SpaceRobotError: If there is no such method or quantity.
    """
    estimator: ProbabilityEstimator = ESTIMATORS.find(method)
    state = build_limit_state(to_scene(scene), quantity, limit, threads=threads)
    counted = CountedLimitState(state)
    estimate, search = estimate_probability(counted, estimator, effort or SamplingEffort())
    points, names = sorted((*search.points, *estimate.points), key=lambda point: point.beta), state.names
    failures = [
        MostProbableFailure(
            point.beta,
            dict(zip(names, map(float, state.draws(point.z[None])[0][0]), strict=True)),
            dict(zip(names, map(float, point.direction**2), strict=True)),
        )
        for point in points
    ]
    return FailureProbability(
        state.quantity.name,
        state.unit,
        state.limit,
        method,
        estimate.probability,
        estimate.variation,
        counted.rollouts,
        counted.gradient_rollouts,
        tuple(failures),
        search.starts,
        search.undiscovered if estimator.needs_design_points else None,
        search_warnings(estimator, estimate, search),
    )


def estimate_probability(
    state: CountedLimitState, estimator: ProbabilityEstimator, effort: SamplingEffort
) -> tuple[ProbabilityEstimate, DesignPointSearch]:
    """Probability that a limit state is negative, and the search for its design points.

    Args:
        state: The limit state.
        estimator: Method of the estimate.
        effort: Required accuracy, and budget.
    """
    search = DesignPointSearch((), 0, 0, 0)
    if estimator.needs_design_points:
        # another stream of random numbers than the samples', from the same seed
        search = search_design_points(state, effort.rng.spawn(1)[0])
        effort = replace(effort, budget=max(effort.budget - state.rollouts, LEAST))
    return estimator.estimate(state, search.points, effort), search


def search_warnings(
    estimator: ProbabilityEstimator, estimate: ProbabilityEstimate, search: DesignPointSearch
) -> tuple[str, ...]:
    """Reasons why the interval of an estimate may be too narrow."""
    warnings = []
    if estimator.needs_design_points and not (search.points or estimate.points):
        warnings.append(
            f"no most probable failure was found from {search.starts} starts, so that rare failures may be "
            "unseen; compare with --method subset"
        )
    elif estimator.needs_design_points and search.undiscovered > UNSURE:
        warnings.append(
            f"{len(search.points)} most probable failures from {search.starts} starts, of which "
            f"{search.converged} converged; further ones are likely, so that the probability may be larger "
            "than the interval says; compare with --method subset"
        )
    if estimate.points:
        warnings.append(
            f"samples found {len(estimate.points)} most probable failures that the search had missed; "
            "there may be more"
        )
    if estimate.largest > HEAVY:
        warnings.append(
            f"one sample contributes {100 * estimate.largest:.2g} % of the estimate, so that its variation "
            "is uncertain; raise the budget"
        )
    missing = estimator.missing_share(search.points)
    if missing > UNSURE / 10:
        warnings.append(
            f"{estimator.title} sees one of {len(search.points)} regions of failure; the others have about "
            f"{100 * missing:.2g} % of the probability; use importance"
        )
    return tuple(warnings)
