"""Points of a scrambled Sobol sequence."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optim.methods.evolutionary import PointSearch
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class SobolSearch(PointSearch):
    """Points of a scrambled Sobol sequence."""

    name: ClassVar[str] = "sobol"
    title: ClassVar[str] = "Sobol: quasi-random points"
    place: ClassVar[float] = 6

    def points(self, sequence: Any, rng: np.random.Generator, count: int) -> Array:
        """Next points (count, k) of the sequence."""
        del rng
        return np.asarray(sequence.random(count))
