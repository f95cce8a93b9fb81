"""Uniform random points."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optim.methods.evolutionary import PointSearch
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class RandomSearch(PointSearch):
    """Uniform random points."""

    name: ClassVar[str] = "random"
    title: ClassVar[str] = "random: independent points"
    place: ClassVar[float] = 7

    def points(self, sequence: Any, rng: np.random.Generator, count: int) -> Array:
        """Next uniform random points (count, k)."""
        return rng.random((count, sequence.d))
