"""Initial gaps of grasps that a rollout's own parameters may open, and the test that they are closed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array


@dataclass(frozen=True)
class Closure:
    """Initial gaps, and how large they may be.

    Attributes:
        gaps: ``(p) -> (gap)``, in m.
        largest: Maximum allowed gap [m] by name of the grasp, in the same order.
    """

    gaps: ca.Function
    largest: Mapping[str, float]

    def measure(self, p: Array) -> Array:
        """Gaps (N, n) [m] of rows of parameters (N, np); further columns are not read."""
        if not self.largest:
            return np.empty((len(p), 0))
        gaps: Array = self.gaps(p[:, : self.gaps.numel_in(0)].T).full().T
        return gaps

    def is_open(self, gaps: Array) -> npt.NDArray[np.bool_]:
        """Whether each row (N, n) contains a gap above its limit (N,)."""
        return np.asarray((gaps > list(self.largest.values())).any(axis=1), dtype=np.bool_)

    def messages(self, gaps: Array) -> tuple[str, ...]:
        """Description of the open gaps in each row (N, n); empty where all are closed."""
        if not self.largest:
            return ("",) * len(gaps)
        return tuple(unclosed(dict(zip(self.largest, row, strict=True)), self.largest) for row in gaps)


def unclosed(gaps: Mapping[str, float], largest: Mapping[str, float]) -> str:
    """Description of the grasps that do not close; empty if all do.

    Args:
        gaps: Initial gap of each grasp [m].
        largest: Largest allowed gap of each grasp [m].
    """
    return "; ".join(
        f"{name} does not close: its gap is {gap:.4g} m, allowed max_gap {largest[name]:g} m"
        for name, gap in gaps.items()
        if gap > largest[name]
    )
