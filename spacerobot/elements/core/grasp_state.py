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
        mated: Tip axes to mating frame's axes where mated (3x3).
        gap: Vector from mating frame to tip at rest, axes of the mating frame (3x1) [m], while drawn in.
        turn: Rotation vector (3x1) [rad] from where it is mated to the tip's orientation at rest, in axes of
            the mating frame; in a planar scene in world axes.
    """

    closed: ca.SX
    mated: ca.SX
    gap: TimeProfile
    turn: TimeProfile
