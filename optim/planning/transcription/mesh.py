"""The mesh of a motion: how its duration is cut into intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacerobot.arrays import Array

Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """Intervals of a duration, of any lengths.

    Attributes:
        knots: Parts of the duration at which intervals begin and end: 0 first, 1 last, rising (N + 1,).
    """

    knots: tuple[float, ...]

    @classmethod
    def of(cls, mesh: int | Mesh) -> Mesh:
        """A mesh as it is, or one of so many equal intervals."""
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
        """Length of each interval (N,); their sum is one."""
        return np.diff(self.knots)

    def located(self, parts: Array) -> tuple[Places, Array]:
        """Interval (n,) in which each part of the duration (n,) lies, and where in it, 0 to 1 (n,)."""
        inside = np.searchsorted(self.knots, parts, side="right") - 1
        inside = np.clip(inside, 0, self.intervals - 1).astype(np.int64)
        return inside, (parts - self.starts[inside]) / self.widths[inside]

    def split(self, counts: Sequence[int]) -> Mesh:
        """Each interval cut into so many equal ones (N,)."""
        ends = zip(self.knots[:-1], self.knots[1:], counts, strict=True)
        inner = [a + (b - a) * k / count for a, b, count in ends for k in range(count)]
        return Mesh((*inner, 1.0))
