"""State of a grasp that opens and closes: its switch, and the tip's pose in the mating frame."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from spacerobot.elements.core.desired_motion import TimeProfile


@dataclass(frozen=True)
class GraspState:
    """State of a grasp that opens or closes during the simulation.

    Attributes:
        closed: Switch (1x1).
        mated: Rotation from tip axes to the mating frame's axes at the mated pose (3x3).
        gap: Vector from the mating frame to the tip's rest position, mating-frame axes (3x1) [m], during
            draw-in.
        turn: Rotation vector (3x1) [rad] from the mated to the tip's rest orientation, mating-frame axes;
            world axes in a planar scene.
    """

    closed: ca.SX
    mated: ca.SX
    gap: TimeProfile
    turn: TimeProfile
