"""Grasps: what holds a tip and a mating frame of the target together.

All act as *one* pair of opposite wrenches at one point, the tip's, so that momentum is conserved to rounding.
Velocities are those of the tip relative to the target's material point that coincides with it. The mating
points' own motion (Eq. 14-25) follows from the target's frames; a test holds it to the printed formulas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
from pydantic import Field

from spacerobot.dynamics.algebra import cross
from spacerobot.elements.context import GraspContext
from spacerobot.elements.contribution import Contribution, Output
from spacerobot.elements.element import Element
from spacerobot.section import quantity

OBSERVED = {
    "grasp_force": ("N", "force of grasps on the target"),
    "grasp_torque": ("N m", "torque of grasps on the target, at the tip"),
    "grasp_gap": ("m", "from mating frames to tips"),
}
"""Vectors that every grasp declares: unit and text."""


class Grasp(Element):
    """A connection of a tip and a mating frame.

    Attributes
    ----------
    fixes_position, fixes_orientation
        What a rigid connection takes away: the two or three translations, and the one or three rotations.
    """

    family: ClassVar[str] = "grasp"
    fixes_position: ClassVar[bool] = False
    fixes_orientation: ClassVar[bool] = False

    tip: str = Field(pattern=r"^[^/]+/[^/]+$", description="the tip, as robot/tip")
    frame: str = Field(min_length=1, description="mating frame: a link of the target's URDF")
    max_gap: float = quantity(
        "m", "greatest distance of tip and mating frame at the start", default=0.01, ge=0
    )

    def build(self, grasp: GraspContext) -> Contribution:
        """What it adds to the closed loop."""
        raise NotImplementedError


@dataclass(frozen=True)
class Relative:
    """Tip relative to mating frame, world axes.

    Attributes
    ----------
    gap
        From mating frame to tip (3x1) [m].
    twist
        Rotation vector from the mating frame's orientation, turned as at the start, to the tip's (3x1) [rad].
    velocity, spin
        Of the tip relative to the target at the tip's point (3x1 each) [m/s, rad/s].
    """

    gap: ca.SX
    twist: ca.SX
    velocity: ca.SX
    spin: ca.SX


def relative_motion(grasp: GraspContext) -> Relative:
    """Relative position, orientation and velocity of a grasp's two frames."""
    plant, start = grasp.plant, grasp.start
    tip_rotation, tip_position = plant.placement(grasp.tip_frame)
    mate_rotation, mate_position = plant.placement(grasp.mate_frame)
    tip_velocity, tip_spin = plant.velocity(grasp.tip_frame)
    mate_velocity, mate_spin = plant.velocity(grasp.mate_frame)
    gap = tip_position - mate_position
    tip0, mate0 = start.placement(grasp.tip_frame)[0], start.placement(grasp.mate_frame)[0]
    rest = grasp.context.once("rest", ca.mtimes(mate0.T, tip0))
    return Relative(
        gap,
        plant.orientation_error(tip_rotation, ca.mtimes(mate_rotation, rest)),
        tip_velocity - mate_velocity - cross(mate_spin, gap),
        tip_spin - mate_spin,
    )


def observed(grasp: GraspContext, relative: Relative, force: ca.SX, torque: ca.SX) -> tuple[Output, ...]:
    """Force and torque on the target at the tip's point (3x1 each), and the gap."""
    values = {"grasp_force": force, "grasp_torque": torque, "grasp_gap": relative.gap}
    return tuple(Output(name, value, *OBSERVED[name], "grasp", grasp.name) for name, value in values.items())


def only(vector: ca.SX, axes: tuple[int, ...]) -> ca.SX:
    """Vector (3x1) with the other components structurally zero."""
    kept = ca.SX(3, 1)
    for axis in axes:
        kept[axis] = vector[axis]
    return kept
