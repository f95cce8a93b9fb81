"""What a rollout needs to know of a closed loop, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import casadi as ca
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class ClosedLoopFunctions(Protocol):
    """A closed loop as SX functions without free variables.

    The state is x = (q, v, z): Pinocchio's configuration and velocity, and the states of controllers.
    """

    @property
    def parameter_paths(self) -> tuple[str, ...]:
        """Dotted paths of the parameters p."""

    @property
    def parameter_values(self) -> Array:
        """Nominal p, in scenario units."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """One name for each entry of x."""

    @property
    def nq(self) -> int:
        """Length of q."""

    @property
    def nv(self) -> int:
        """Length of v."""

    @property
    def nz(self) -> int:
        """Length of z."""

    @property
    def jumps(self) -> tuple[int, ...]:
        """Places in c of the times [s] at which the dynamics jump.

        The dynamics tell by ``t < c[place]`` on which side of a jump they are, and use these entries for
        nothing else: a rollout, whose steps never cross a jump, writes plus infinity there before the jump
        and minus infinity after it.
        """

    @property
    def setup(self) -> ca.Function:
        """``(p) -> (x0, c)``: initial state and prepared constants."""

    @property
    def dynamics(self) -> ca.Function:
        """``(t, x, c) -> (xdot)``."""

    @property
    def normalise(self) -> ca.Function:
        """``(x) -> (x)``: puts cos/sin pairs and quaternions back on their unit sphere."""

    @property
    def gaps(self) -> ca.Function:
        """``(p) -> (gap)``: initial gaps in m of the grasps that may begin open."""

    @property
    def max_gaps(self) -> Mapping[str, float]:
        """Greatest gaps allowed in m, by name of the grasp, in the order of ``gaps``."""

    @property
    def outputs(self) -> ca.Function:
        """``(t, x, c) -> (named vectors)``."""
