"""Grasps: connections between a tip and a mating frame of the target.

A kind defines the connection; capture and release are common to all
(:mod:`spacerobot.elements.grasps.capture_release`).

Every grasp exerts *one* pair of opposite wrenches at one point, the tip's, so momentum is conserved to
rounding. Velocities are those of the tip relative to the coincident material point of the target. The mating
points' own motion (Eq. 14-25) follows from the target's frames; a test compares it with the printed formulas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.registry import required
from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements.core.context import GraspContext
from spacerobot.elements.core.contribution import Contribution, Output, PowerTerm
from spacerobot.elements.core.element import Element
from spacerobot.elements.grasps.capture import Capture, GraspFailure, Release

OBSERVED = {
    "grasp_force": ("N", "force of grasps on the target"),
    "grasp_torque": ("N m", "torque of grasps on the target, at the tip"),
    "grasp_gap": ("m", "from mating frames to tips"),
}
"""Vectors that every grasp declares as outputs: unit and text."""


@dataclass(frozen=True)
class Displacement:
    """Displacement of the tip from a grasp's rest pose, world axes (3x1 each).

    Attributes:
        gap, twist: Displacement [m] and rotation vector [rad].
        velocity, spin: Velocity and angular velocity of the tip relative to the target at its point [m/s,
            rad/s].
    """

    gap: ca.SX
    twist: ca.SX
    velocity: ca.SX
    spin: ca.SX


class Grasp(Element):
    """A connection of a tip and a mating frame.

    Attributes:
        fixes_position, fixes_orientation: Whether it rigidly prevents the two or three relative translations,
            and the one or three relative rotations.
        has_springs: Whether its wrench depends on the tip's displacement and motion alone:
            :meth:`spring_wrench`.
    """

    family: ClassVar[str] = "grasp"
    fixes_position: ClassVar[bool] = False
    fixes_orientation: ClassVar[bool] = False
    has_springs: ClassVar[bool] = False

    tip: str = Field(pattern=r"^[^/]+/[^/]+$", description="the tip, as robot/tip")
    frame: str = Field(min_length=1, description="mating frame: a link of the target's URDF")
    max_gap: float = quantity(
        "m", "maximum distance of tip and mating frame at the start", default=0.01, ge=0
    )

    begins: Literal["closed", "open"] = Field(
        default="closed", description="whether it holds at the start; an open one closes by `capture`"
    )
    capture: Capture | None = Field(
        default=None, description="conditions of capture while open; never captured if not given"
    )
    release: Release | None = Field(
        default=None, description="conditions of release; never released if not given"
    )
    failure: GraspFailure | None = Field(
        default=None, description="the gripper misses, jams or weakens, `at` a time"
    )

    @model_validator(mode="after")
    def _check_life(self) -> Grasp:
        if self.begins == "open" and self.capture is None:
            raise ValueError("capture: missing, so that a grasp that begins open can never close")
        closes = None if self.capture is None else self.capture.at
        opens = None if self.release is None else self.release.at
        if closes is not None and opens is not None and opens <= closes:
            raise ValueError(
                f"release.at: found {opens:g} s, allowed: later than `capture.at` ({closes:g} s), for what "
                "is captured then is released at once"
            )
        mode = None if self.failure is None else self.failure.mode
        if mode == "misses" and self.capture is None:
            raise ValueError("failure.mode: found misses, but without `capture` it never closes")
        if mode == "weak" and (self.release is None or self.release.force is self.release.torque is None):
            raise ValueError("failure.mode: found weak, but there is no `release.force` nor `release.torque`")
        return self

    @property
    def is_rigid(self) -> bool:
        """Whether it is rigid, so that closing it is an impact."""
        return self.fixes_position or self.fixes_orientation

    def life(self, *, released_by_phase: bool = False) -> str:
        """Conditions of capture and release in words.

        Args:
            released_by_phase: Whether a phase releases the grasp.
        """
        conditions = []
        if self.begins == "open" and self.capture is not None:
            conditions.append(f"open, {self.capture.words()}")
        ending = "released by phases" if released_by_phase else "never released"
        conditions.append(ending if self.release is None else self.release.words())
        return "; ".join(conditions)

    @property
    def holds_orientation(self) -> bool:
        """Whether it also holds the tip's orientation, rigidly or by springs and dampers."""
        return self.fixes_orientation

    @required("has_springs")
    def spring_wrench(self, number: Callable[[str], ca.SX], tip: Displacement) -> tuple[ca.SX, ca.SX]:
        """Force [N] and torque [N m] of springs and dampers on the target, world axes (3x1 each).

        Args:
            number: Function from a key of this section to its value (1x1): a symbol in a closed loop, the
                number itself in a plan.
            tip: Displacement of the tip from the rest pose.

        Raises:
            NotImplementedError: If :attr:`has_springs` is not set: the wrench of a rigid grasp depends on
                more than the displacement.
        """
        raise NotImplementedError

    @required()
    def build(self, grasp: GraspContext) -> Contribution:
        """Contribution to the closed loop while it is closed."""
        raise NotImplementedError


@dataclass(frozen=True)
class RestPose:
    """Rest pose of the tip relative to the mating frame, world axes (3x1 each).

    Attributes:
        gap: Vector from mating frame to tip [m].
        velocity, spin: Velocity and angular velocity of the rest pose during draw-in [m/s, rad/s].
        acceleration, angular_acceleration: Rates of these, as the mating frame rotates [m/s^2, rad/s^2].
    """

    gap: ca.SX
    velocity: ca.SX
    spin: ca.SX
    acceleration: ca.SX
    angular_acceleration: ca.SX

    def powers(self, force: ca.SX, torque: ca.SX) -> tuple[PowerTerm, ...]:
        """Power of drawing in, by a force and a torque on the target (3x1 each); none for a fixed grasp."""
        if not self.velocity.nnz() and not self.spin.nnz():
            return ()
        return (PowerTerm("draw_in", -ca.dot(force, self.velocity) - ca.dot(torque, self.spin), "in"),)


@dataclass(frozen=True)
class RelativeMotion:
    """Motion of the tip relative to the rest pose of a grasp, world axes.

    Attributes:
        gap: Vector from the rest position to the tip (3x1) [m]; the rest position is the mating frame unless
            captured elsewhere.
        twist: Rotation vector from the rest orientation (initial or as captured) to the tip's (3x1) [rad].
        velocity, spin: Velocity and spin of the tip relative to the target at the tip's point, minus those of
            the rest pose (3x1 each) [m/s, rad/s].
        rest: Rest pose.
    """

    gap: ca.SX
    twist: ca.SX
    velocity: ca.SX
    spin: ca.SX
    rest: RestPose


def relative_motion(grasp: GraspContext) -> RelativeMotion:
    """Relative position, orientation and velocity of a grasp's two frames."""
    plant, start, hold = grasp.plant, grasp.start, grasp.hold
    tip_rotation, mate_rotation = plant.placement(grasp.tip_frame)[0], plant.placement(grasp.mate_frame)[0]
    if hold is None:
        tip0, mate0 = start.placement(grasp.tip_frame)[0], start.placement(grasp.mate_frame)[0]
        mated_rotation = ca.mtimes(mate_rotation, grasp.context.once("rest", ca.mtimes(mate0.T, tip0)))
        none = ca.SX(3, 1)
        rest_pose = RestPose(none, none, none, none, none)
    else:
        # rest orientation (3x3) and rest position of the tip, which move during draw-in
        mate_spin = plant.velocity(grasp.mate_frame)[1]
        value, rate, acceleration = (
            part if plant.planar else ca.mtimes(mate_rotation, part)
            for part in (hold.turn.value, hold.turn.rate, hold.turn.acceleration)
        )
        mated = ca.mtimes(mate_rotation, hold.mated)
        moving = ca.mtimes(mate_rotation, hold.gap.rate)
        rest_pose = RestPose(
            ca.mtimes(mate_rotation, hold.gap.value),
            moving,
            rate,
            cross(mate_spin, moving) + ca.mtimes(mate_rotation, hold.gap.acceleration),
            cross(mate_spin, rate) + acceleration,
        )
        mated_rotation = ca.mtimes(rotation_exp(value), mated) if value.nnz() else mated
    gap, velocity, spin = apart(grasp)
    return RelativeMotion(
        gap - rest_pose.gap,
        plant.orientation_error(tip_rotation, mated_rotation),
        velocity - rest_pose.velocity,
        spin - rest_pose.spin,
        rest_pose,
    )


def apart(grasp: GraspContext) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Vector from mating frame to tip, and the tip's velocity and spin relative to the target (3x1 each)."""
    plant = grasp.plant
    tip_velocity, tip_spin = plant.velocity(grasp.tip_frame)
    mate_velocity, mate_spin = plant.velocity(grasp.mate_frame)
    gap = plant.placement(grasp.tip_frame)[1] - plant.placement(grasp.mate_frame)[1]
    return gap, tip_velocity - mate_velocity - cross(mate_spin, gap), tip_spin - mate_spin


def observed(
    grasp: GraspContext, relative: RelativeMotion, force: ca.SX, torque: ca.SX
) -> tuple[Output, ...]:
    """Force and torque on the target at the tip's point (3x1 each), and the gap."""
    values = {"grasp_force": force, "grasp_torque": torque, "grasp_gap": relative.gap + relative.rest.gap}
    return tuple(Output(name, value, *OBSERVED[name], "grasp", grasp.name) for name, value in values.items())


def only(vector: ca.SX, axes: tuple[int, ...]) -> ca.SX:
    """Vector (3x1) with the other components structurally zero."""
    components = ca.SX(3, 1)
    for axis in axes:
        components[axis] = vector[axis]
    return components
