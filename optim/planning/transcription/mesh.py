"""The mesh of a motion: division of its duration into intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array

Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """Division of a duration into intervals of any lengths.

    Attributes:
        knots: Shares of the duration at the interval ends, from 0 to 1 in ascending order (N + 1,).
    """

    knots: tuple[float, ...]

    @classmethod
    def of(cls, mesh: int | Mesh) -> Mesh:
        """The given mesh, or a mesh with the given number of equal intervals."""
        return mesh if isinstance(mesh, Mesh) else cls(tuple(n / mesh for n in range(mesh + 1)))

    @property
    def intervals(self) -> int:
        """Number of intervals, N."""
        return len(self.knots) - 1

    @property
    def starts(self) -> Array:
        """Start of each interval as a share of the duration (N,)."""
        return np.array(self.knots[:-1])

    @property
    def widths(self) -> Array:
        """Length of each interval as a share of the duration (N,)."""
        return np.diff(self.knots)

    def located(self, parts: Array) -> tuple[Places, Array]:
        """Interval (n,) that contains each share of the duration (n,), and place in it, 0 to 1 (n,)."""
        inside = np.searchsorted(self.knots, parts, side="right") - 1
        inside = np.clip(inside, 0, self.intervals - 1).astype(np.int64)
        return inside, (parts - self.starts[inside]) / self.widths[inside]

    def split(self, counts: Sequence[int]) -> Mesh:
        """Mesh with each interval divided into a number of equal ones (N,)."""
        ends = zip(self.knots[:-1], self.knots[1:], counts, strict=True)
        inner = [a + (b - a) * k / count for a, b, count in ends for k in range(count)]
        return Mesh((*inner, 1.0))
