"""Base class of estimators of failure probabilities, and their result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.reliability.design_points import DesignPoint
from optim.reliability.limit_state import LimitState
from spacerobot.common.registry import ESTIMATORS, Registry, required


@dataclass(frozen=True)
class SamplingEffort:
    """Required accuracy of an estimate, and its budget.

    Attributes:
        variation: Coefficient of variation (standard deviation over value) at which sampling ends.
        budget: Maximum number of rollouts.
        seed: Seed of everything random.
    """

    variation: float = 0.1
    budget: int = 20_000
    seed: int = 0

    @property
    def rng(self) -> np.random.Generator:
        """A generator of random numbers from the seed."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True)
class ProbabilityEstimate:
    """An estimate of a probability.

    Attributes:
        probability, variation: The estimate and its coefficient of variation; infinite if no failure was
            found.
        largest: Share of the estimate that the sample with the largest weight contributes.
        points: Design points found from samples, in addition to those of the search.
    """

    probability: float
    variation: float
    largest: float = 0.0
    points: tuple[DesignPoint, ...] = ()


class ProbabilityEstimator:
    """An estimator of failure probabilities.

    One derives from this class, states its name, and is decorated with ``spacerobot.register``.

    Attributes:
        name, title, place: Name in options and files, title for people, and position in lists.
        needs_design_points: Whether it starts from design points, whose search needs gradients.
    """

    registry: ClassVar[Registry] = ESTIMATORS
    name: ClassVar[str]
    title: ClassVar[str] = ""
    place: ClassVar[float] = 100.0
    needs_design_points: ClassVar[bool] = True

    @required()
    def estimate(
        self, state: LimitState, points: Sequence[DesignPoint], effort: SamplingEffort
    ) -> ProbabilityEstimate:
        """Probability that a limit state is negative under the standard normal distribution.

        Args:
            state: The limit state.
            points: Design points of the limit state; none unless the estimator needs them.
            effort: Required accuracy, and budget.
        """
        raise NotImplementedError

    def missing_share(self, points: Sequence[DesignPoint]) -> float:  # noqa: ARG002
        """First-order share of the failure probability in regions that the estimator does not sample."""
        return 0.0


def mean_of(values: np.typing.NDArray[np.float64]) -> ProbabilityEstimate:
    """Mean of independent samples (n,), with its coefficient of variation."""
    mean = float(values.mean())
    if mean == 0:
        return ProbabilityEstimate(0.0, np.inf)
    return ProbabilityEstimate(mean, float(values.std(ddof=1)) / np.sqrt(len(values)) / mean)
