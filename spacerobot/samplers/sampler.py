"""Base class of samplers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Protocol

from spacerobot.common.arrays import Array
from spacerobot.common.registry import SAMPLERS, Registry, required


class SampledParameter(Protocol):
    """Properties of an uncertain parameter that samplers use."""

    @property
    def lower(self) -> float | None:
        """Lower bound of the distribution; None if it is unbounded."""

    @property
    def levels(self) -> int | None:
        """Number of levels of a grid; the campaign's if None."""


class SamplingPlan(Protocol):
    """Properties of a campaign that samplers use."""

    @property
    def parameters(self) -> Mapping[str, SampledParameter]:
        """Uncertain parameters by name."""

    @property
    def samples(self) -> int:
        """Number of requested samples."""

    @property
    def levels(self) -> int:
        """Number of levels of a grid."""

    @property
    def seed(self) -> int:
        """Seed of the random numbers."""


class Sampler:
    """Base class of samplers, which draw points of the unit cube.

    A sampler derives from this class, states its name, and is decorated with ``spacerobot.register``.

    Attributes:
        name, place: Name in scenarios, and place in lists.
        summary: Short description for the documentation.
        takes_correlation: Whether correlation may be imposed on the points.
        has_intervals: Whether samples follow the distributions, so that confidence intervals are valid.
        reaches_bounds: Whether coordinates may be 0 and 1.
        is_factorial: Whether every combination of levels is drawn, so that two parameters span a table.
        gives_sobol_indices: Whether Sobol' indices can be estimated from the order of the points.
        has_any_size: Whether it draws any number of samples. A caller that needs another number of samples
            draws Sobol points instead.
    """

    registry: ClassVar[Registry] = SAMPLERS
    name: ClassVar[str]
    place: ClassVar[float] = 100.0
    summary: ClassVar[str] = ""
    takes_correlation: ClassVar[bool] = True
    has_intervals: ClassVar[bool] = True
    reaches_bounds: ClassVar[bool] = False
    is_factorial: ClassVar[bool] = False
    gives_sobol_indices: ClassVar[bool] = False
    has_any_size: ClassVar[bool] = True

    def count(self, plan: SamplingPlan) -> int:
        """Number of points that the sampler draws."""
        return plan.samples

    def check(self, plan: SamplingPlan) -> None:
        """Check that the sampler can draw the samples of a campaign.

        Raises:
            ValueError: If it cannot; the message begins with the key of the scenario.
        """

    @required()
    def points(self, plan: SamplingPlan) -> Array:
        """Points of the unit cube (N, k) with independent coordinates, in the order of the parameters.

        Raises:
            SpaceRobotError: If it needs a package that is not installed.
        """
        raise NotImplementedError
