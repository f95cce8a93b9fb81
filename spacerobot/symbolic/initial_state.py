"""Initial state as expressions of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from spacerobot.dynamics import Kinematics, frame_placement


@dataclass(frozen=True)
class InitialState:
    """Initial state as expressions of the parameters.

    Attributes:
        model: The scene's ``pinocchio.Model``.
        q, v: Configuration (nq x 1) and velocity (nv x 1), Pinocchio's coordinates.
        kinematics: Kinematics of the initial configuration at rest.
    """

    model: Any
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame at the start, world axes."""
        return frame_placement(self.model, self.kinematics, frame)
