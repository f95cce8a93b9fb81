"""Base class of samplers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Protocol

from spacerobot.common.arrays import Array
from spacerobot.common.registry import SAMPLERS, Registry, required


class SampledParameter(Protocol):
    """An uncertain parameter as samplers see it: the bounds of its distribution, and levels of a grid."""

    @property
    def lower(self) -> float | None:
        """Lower bound, if there is one."""

    @property
    def levels(self) -> int | None:
        """Levels of a grid; the campaign's if None."""


class SamplingPlan(Protocol):
    """A campaign as samplers see it."""

    @property
    def parameters(self) -> Mapping[str, SampledParameter]:
        """Uncertain parameters by name."""

    @property
    def samples(self) -> int:
        """Number of samples that are requested."""

    @property
    def levels(self) -> int:
        """Levels of a grid."""

    @property
    def seed(self) -> int:
        """Seed of everything random."""


class Sampler:
    """A way to draw points of the unit cube.

    A sampler derives from this class, states its name, and is decorated with ``spacerobot.register``.

    Attributes:
        name, place: In scenarios, and its place in lists.
        summary: A few words for the documentation.
        takes_correlation: Whether its points may be correlated afterwards.
        has_intervals: Whether its samples are drawn from the distributions, so that confidence intervals
            hold.
        reaches_bounds: Whether coordinates may be 0 and 1.
        is_factorial: Whether every combination of levels is there, so that two parameters span a table.
        gives_sobol_indices: Whether Sobol' indices follow from its order.
        has_any_size: Whether it draws any number of samples; what needs another number draws Sobol points
            instead.
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
        """Number of samples in all."""
        return plan.samples

    def check(self, plan: SamplingPlan) -> None:
        """Refuse what it cannot draw.

        Raises:
            ValueError: Its text begins with the key.
        """

    @required()
    def points(self, plan: SamplingPlan) -> Array:
        """Points of the unit cube (N, k), independent coordinates, in the order of the parameters.

        Raises:
            SpaceRobotError: If it needs a package that is not installed.
        """
        raise NotImplementedError
