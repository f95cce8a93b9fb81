"""Where everything begins, as expressions of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from spacerobot.dynamics import Kinematics, frame_placement


@dataclass(frozen=True)
class InitialState:
    """The initial state, an expression of the parameters.

    Attributes:
        q, v: Configuration (nq x 1) and velocity (nv x 1), Pinocchio's coordinates.
        kinematics: Of the initial configuration at rest.
    """

    model: Any
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame at the start."""
        return frame_placement(self.model, self.kinematics, frame)
