"""Instant of a planned trajectory, as goals, costs and limits evaluate it, and its constraint rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeVar

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import sparse
from spacerobot.elements.shapes.collision_shape import Wrap
from spacerobot.shapes import Implicit

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class BoundedRow:
    """Scalar constraint between limits.

    Attributes:
        name: Name for messages and tables.
        unit: Unit of the values times the scale.
        value: Expression (1x1) in an instant, and in the symbol of ``about``.
        lower, upper: Limits.
        final_fraction: Fraction of the duration, at its end, in which the constraint holds.
        scale: Violation, in that unit, that counts as one.
        first: Whether the constraint holds only at the first instant.
        form: Form of the value: the quantity itself, its square over the squared limit, or an angle's cosine.
        size: Magnitude of the limit, in that unit, to which violations between the points are relative.
        about: Implicit quantity that an iteration solves for, held constant in the derivatives of ``value``.
        fastest: Upper bound (1x1) of the rate of ``value`` [1/s]; None where it is not known. With it the
            verification bounds the value between the instants at which it looks.
    """

    name: str
    unit: str
    value: ca.SX
    lower: float = -np.inf
    upper: float = np.inf
    final_fraction: float = 1.0
    scale: float = 1.0
    size: float | None = None
    first: bool = False
    about: Implicit | None = None
    fastest: ca.SX | None = None
    form: Literal["itself", "square", "cosine"] = "itself"

    def held(self, share: Array, begins: float) -> npt.NDArray[np.bool_]:
        """Points at which the constraint holds.

        Args:
            share: Elapsed fractions of the duration at the points, 0 to 1 (n,).
            begins: Fraction of the duration from which the constraint holds; ignored if it holds only at the
                first instant.

        Returns:
            numpy.ndarray: Truth values (n,).
        """
        return np.asarray(share == 0 if self.first else share >= begins - 1e-12)


def zero(name: str, unit: str, value: ca.SX) -> BoundedRow:
    """Equality constraint on a value.

    Args:
        name, unit: Name for messages, and unit of the value.
        value: Expression that must be zero (1x1).
    """
    return BoundedRow(name, unit, value, 0.0, 0.0)


def within(name: str, unit: str, value: ca.SX, limit: float) -> BoundedRow:
    """Bound on a vector's norm: its square divided by that of the limit, which is smooth at zero.

    Args:
        name, unit: Name for messages, and unit of the vector.
        value: The vector (n x 1).
        limit: Maximum norm, in that unit.
    """
    square = ca.sumsqr(value) / limit**2
    return BoundedRow(name, unit, square, upper=1.0, scale=limit / 2, form="square")


def matched(
    name: str, unit_name: str, value: ca.SX, axes: Sequence[int], tolerance: float | None
) -> Iterator[BoundedRow]:
    """Constraints that components of a vector are zero, or that their norm is within a tolerance.

    Args:
        name, unit_name: Name and unit of the vector.
        value: The vector (3x1).
        axes: Indices of the constrained components.
        tolerance: Upper bound of the norm of these components, in that unit; None for equality with zero.

    Yields:
        BoundedRow: One equality per component, or one bound on the norm.
    """
    if tolerance is None:
        yield from (zero(f"{name} {'xyz'[i]}", unit_name, value[i]) for i in axes)
    else:
        yield within(name, unit_name, value[list(axes)], tolerance)


def unit(axis: Sequence[float]) -> ca.SX:
    """Unit vector along an axis (3x1), structurally zero where the axis is."""
    return sparse(np.array(axis) / np.linalg.norm(axis))


class MovingFrame(NamedTuple):
    """A frame that moves, world axes.

    Attributes:
        rotation, origin: Rotation to world axes (3x3), and position of the origin (3x1) [m].
        velocity, spin: Velocity and angular velocity (3x1 each) [m/s, rad/s].
    """

    rotation: ca.SX
    origin: ca.SX
    velocity: ca.SX
    spin: ca.SX

    def seen_from(self, other: MovingFrame) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Position (3x1) [m], velocity (3x1) [m/s] and spin (3x1) [rad/s] in another frame."""
        away = self.origin - other.origin
        relative = self.velocity - other.velocity - cross(other.spin, away)
        place, speed, spin = (
            ca.mtimes(other.rotation.T, value) for value in (away, relative, self.spin - other.spin)
        )
        return place, speed, spin


class JointCoordinate(NamedTuple):
    """Joint of one degree of freedom.

    Attributes:
        name: Name of the joint in the URDF.
        position: Position (1x1) [rad or m]; cosine and sine of the angle (2x1) for an unbounded joint.
        rate: Rate (1x1) [rad/s or m/s].
        lower, upper: Range in the URDF [rad or m]; infinite without a limit.
    """

    name: str
    position: ca.SX
    rate: ca.SX
    lower: float
    upper: float

    def off(self, desired: float) -> ca.SX:
        """Difference from a desired position (1x1) [rad or m]; below half a turn for an unbounded joint."""
        if self.position.numel() == 1:
            return self.position - desired
        c, d, (q, s) = float(np.cos(desired)), float(np.sin(desired)), ca.vertsplit(self.position)
        return ca.atan2(s * c - q * d, q * c + s * d)


class PlanInstant(Protocol):
    """Instant of the trajectory for the evaluation of a plan's goals, costs and limits.

    A ``key`` is the key of the section that holds the name, for messages. Every method raises
    :class:`spacerobot.common.errors.ScenarioError` for an unknown name.
    """

    def signal(self, name: str) -> Mapping[str, ca.SX]:
        """Columns of a signal by label, of which quantities are expressions.

        Args:
            name: ``joint_torque``, ``joint_rate``, ``joint_acceleration``, ``tip_position``,
                ``tip_velocity``, ``base_force``, ``base_torque`` (root link's axes), ``base_rotation``,
                ``base_translation``, ``base_velocity``, ``base_spin`` (world axes), ``reaction_force``,
                ``reaction_torque`` (of arms on their base about its origin, world axes; on a fixed base with
                the opposite sign), ``grasp_force``, ``grasp_torque``, ``single_wheel_momentum``,
                ``vibration_energy`` or ``arrival`` (velocity and spin of tips relative to the mating frames
                that goals bring them to).
        """

    @property
    def axes(self) -> Sequence[int]:
        """Axes of translation in the scene: x and y, or all."""

    @property
    def turns(self) -> Sequence[int]:
        """Axes of rotation in the scene: z, or all."""

    def tip(self, label: str, key: str = "tip") -> MovingFrame:
        """Frame of a tip.

        Args:
            label: The tip, as robot/tip.
            key: Key of the section that names it.
        """

    def mating(self, link: str, key: str = "frame") -> MovingFrame:
        """Frame of a link of the target.

        Args:
            link: Name of the link.
            key: Key of the section that names it.
        """

    def root(self, body: str, key: str) -> tuple[ca.SX, ca.SX]:
        """Velocity [m/s] and spin [rad/s] of a floating root link, along those of its axes in which it moves.

        Args:
            body: Name of the body.
            key: Key of the section that names it.
        """

    def joined(self, body: str, key: str) -> Sequence[str]:
        """Names of a body and of the bodies joined to it by closed grasps, that body first.

        Args:
            body: Name of the body.
            key: Key of the section that names it.
        """

    def base(self, robot: str, key: str) -> MovingFrame:
        """Frame of a robot's floating root link.

        Args:
            robot: Name of the robot.
            key: Key of the section that names it.
        """

    def joints(self, robot: str, values: Mapping[str, T], key: str) -> Iterator[tuple[JointCoordinate, T]]:
        """Joints of a robot that match patterns, each with the value of its pattern.

        Args:
            robot: Name of the robot.
            values: Values by joint name or pattern.
            key: Key of the section that holds them.
        """

    def turned(self, desired: ca.SX, actual: ca.SX) -> ca.SX:
        """Rotation vector from one orientation to another [rad], in the axes of the first.

        Args:
            desired, actual: Orientations to start from and to reach, as rotations to world axes (3x3 each).

        Returns:
            casadi.SX: Vector with as many entries as :attr:`turns`.
        """

    def fault(self, message: str, key: str) -> ScenarioError:
        """Error that names the place of a key of the section.

        Args:
            message: Text of the error.
            key: Key of the section.
        """

    def link(self, label: str, key: str = "link") -> MovingFrame:
        """Frame of a robot's link.

        Args:
            label: The link, as robot/link.
            key: Key of the section that names it.
        """

    def flexible(self, body: str, key: str) -> Mapping[str, tuple[ca.SX, ca.SX]]:
        """Position [rad or m] and rate of each joint of a body's flexible links (1x1 each), by its name.

        Args:
            body: Name of the body, which must have some.
            key: Key of the section that names it.
        """

    def gaps(
        self, between: tuple[str, str], wrap: Wrap | None
    ) -> Iterator[tuple[str, ca.SX, Implicit, ca.SX]]:
        """Distances between pairs of shapes.

        Args:
            between: Two sides, each a pad or the links whose shapes count.
            wrap: Shape that replaces meshes and cylinders, if any.

        Returns:
            Iterator: Label, distance (1x1) [m], underlying implicit quantity, and upper bound of the
                distance's rate (1x1) [m/s] of each pair.
        """
