"""References as functions of time (Eq. 39-44).

A reference consists of pieces (the motion, and the rest behind it) whose accelerations do not meet. So each
evaluation says by a second time, ``within``, which piece it means: an integrator that works on the interval
before a joint then never looks across it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from spacerobot.common.arrays import Array
from spacerobot.elements import Reference
from spacerobot.elements.references.brake import Brake
from spacerobot.elements.references.circle import Circle
from spacerobot.elements.references.hold import Hold
from spacerobot.elements.references.line import Line
from spacerobot.elements.references.reference import TimedReference
from spacerobot.elements.references.spline import Spline
from spacerobot.scene import Scene, SceneTip
from tests.oracles.engine.kinematics import Kinematics, cross
from tests.oracles.engine.laws import refusal

Jet = tuple[Array, Array, Array]
"""A value with its first and second derivative with respect to time."""

Path = Callable[[float, float], Jet]


@dataclass(frozen=True)
class Motion:
    """Where a frame shall be and how it shall move: (3,) and (3, 3) arrays, world axes, SI units."""

    position: Array
    velocity: Array
    acceleration: Array
    rotation: Array
    angular_velocity: Array
    angular_acceleration: Array


@dataclass(frozen=True)
class TipReference:
    """Reference of one tip.

    Attributes:
        path: ``(t, within)`` to the displacement since the start (3,) [m] with its derivatives.
        turn: ``(t, within)`` to the rotation vector since the start (3,) [rad] with its derivatives; its
            direction is constant.
        pivot: Where the displaced point begins (3,) [m].
        lever: From the pivot to the tip at the start (3,) [m]; turns with the reference.
        rotation: The tip's orientation at the start (3, 3).
        ends: Times since the start at which it is not smooth, beside those that its section tells [s].
    """

    path: Path
    turn: Path
    pivot: Array
    lever: Array
    rotation: Array
    ends: tuple[float, ...] = ()

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""
        del kinematics
        displacement, velocity, acceleration = self.path(t, within)
        angle, spin, spin_rate = self.turn(t, within)
        turned = pin.exp3(angle)
        lever = turned @ self.lever
        swing = cross(spin, lever)
        return Motion(
            position=self.pivot + displacement + lever,
            velocity=velocity + swing,
            acceleration=acceleration + cross(spin_rate, lever) + cross(spin, swing),
            rotation=turned @ self.rotation,
            angular_velocity=spin,
            angular_acceleration=spin_rate,
        )


class Leads(Protocol):
    """What leads a tip; ``ends`` as of a :class:`TipReference`."""

    @property
    def ends(self) -> tuple[float, ...]:
        """Times since it began at which it is not smooth, beside those that its section tells [s]."""

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""


@dataclass(frozen=True)
class Begins:
    """A tip and the target when a reference begins to lead it.

    Attributes:
        scene, tip: The scene, and the tip.
        start: Where everything is, and how it moves.
        carried: Whether the reference belongs to the target, whose centre it then moves, and not to the tip
            itself.
        ahead: What led the tip until now, where the reference begins there and not at the tip's pose.
    """

    scene: Scene
    tip: SceneTip
    start: Kinematics
    carried: bool
    ahead: Motion | None = None

    @property
    def frame(self) -> Motion:
        """Where the reference begins and how that moves; its accelerations count for nothing."""
        if self.ahead is not None:
            return self.ahead
        own, none = self.start.frame(self.tip.frame), np.zeros(3)
        return Motion(own.position, own.velocity[:3], none, own.rotation, own.velocity[3:], none)

    @property
    def pivot(self) -> Array | None:
        """Position (3,) [m] of the target, placed at the tip's reference as it is at the tip."""
        if not self.carried or self.scene.target is None:
            return None
        own, frame = self.start.frame(self.tip.frame), self.frame
        apart = self.start.frame(self.scene.target.root_frame).position - own.position
        place: Array = frame.position + frame.rotation @ own.rotation.T @ apart
        return place


@functools.singledispatch
def leading(reference: Reference, begins: Begins) -> Leads:
    """What leads a tip by a reference, of each kind; where only the way counts, by :func:`path_of`."""
    return _carried(begins, path_of(reference), turn_of(reference))


def _carried(begins: Begins, path: Path, turn: Path, ends: tuple[float, ...] = ()) -> TipReference:
    """A tip that is carried on a way."""
    frame, pivot = begins.frame, begins.pivot
    centre = frame.position if pivot is None else pivot
    return TipReference(path, turn, centre, frame.position - centre, frame.rotation, ends)


@leading.register
def _(brake: Brake, begins: Begins) -> Leads:
    """Velocities fall by 1 - 3 u^2 + 2 u^3."""
    frame, pivot = begins.frame, begins.pivot
    linear, spin = frame.velocity, frame.angular_velocity
    if pivot is not None:
        linear = linear + cross(spin, pivot - frame.position)
    limits = brake.deceleration, np.radians(brake.spin_deceleration_deg)
    end = 1.5 * max(float(np.linalg.norm(v)) / limit for v, limit in zip((linear, spin), limits, strict=True))

    def fading(first: Array) -> Path:
        """What a velocity (3,) that fades leads along, with its first two derivatives."""

        def jet(t: float, within: float) -> Jet:
            """Until it rests, and there."""
            if within >= end:
                return first * end / 2, np.zeros(3), np.zeros(3)
            u = t / end
            return (
                first * (t - t * u**2 + t * u**3 / 2),
                first * (1 - 3 * u**2 + 2 * u**3),
                first * 6 * (u**2 - u) / end,
            )

        return jet

    return _carried(begins, fading(linear), fading(spin), (end,) if end else ())


def cubic_blend(t: float, within: float, duration: float) -> tuple[float, float, float]:
    """From 0 to 1 at rest at both ends, held afterwards (Eq. 42), with its derivatives."""
    if within >= duration:
        return 1.0, 0.0, 0.0
    value = 3 * (t / duration) ** 2 - 2 * (t / duration) ** 3
    rate = 6 * t / duration**2 - 6 * t**2 / duration**3
    return value, rate, 6 / duration**2 - 12 * t / duration**3


def _still(t: float, within: float) -> Jet:
    return np.zeros(3), np.zeros(3), np.zeros(3)


@functools.singledispatch
def path_of(reference: Reference) -> Path:
    """Displacement since the start (3,) [m], of each kind of reference."""
    raise refusal(reference)


@path_of.register
def _(reference: Hold) -> Path:
    del reference
    return _still


@path_of.register
def _(reference: Line) -> Path:
    return _along(np.array(reference.displacement), reference.duration)


@functools.singledispatch
def turn_of(reference: Reference) -> Path:
    """Rotation vector since the start (3,) [rad], of each kind of reference that turns."""
    if type(reference).turned is not Reference.turned:
        raise refusal(reference)
    return _still


@turn_of.register
def _(reference: TimedReference) -> Path:
    return _along(np.radians(reference.rotation_deg), reference.duration)


def _along(vector: Array, duration: float) -> Path:
    """A constant direction, by the cubic blend."""

    def jet(t: float, within: float) -> Jet:
        """Displacement at ``t``, by the piece that holds at ``within``."""
        value, rate, acceleration = cubic_blend(t, within, duration)
        return value * vector, rate * vector, acceleration * vector

    return jet


@path_of.register
def _(circle: Circle) -> Path:
    """Eq. 40, 41, 43 and 44 (its sign corrected) in the circle's plane, minus where it begins."""
    first, last = np.radians(circle.start_deg), np.radians(circle.end_deg)
    plane = pin.rpy.rpyToMatrix(np.radians(circle.plane_deg))
    begin = plane @ np.array([np.cos(first), np.sin(first), 0.0])

    def jet(t: float, within: float) -> Jet:
        """Displacement at ``t``, by the piece that holds at ``within``."""
        value, rate, acceleration = (
            (last - first) * blended for blended in cubic_blend(t, within, circle.duration)
        )
        outwards = plane @ np.array([np.cos(first + value), np.sin(first + value), 0.0])
        ahead = cross(plane[:, 2], outwards)
        return (
            circle.radius * (outwards - begin),
            circle.radius * rate * ahead,
            circle.radius * (acceleration * ahead - rate**2 * outwards),
        )

    return jet


@path_of.register
def _(spline: Spline) -> Path:
    """A clamped cubic spline, held at its end."""
    curve = CubicSpline(spline.times, np.array(spline.displacements), bc_type="clamped")
    end = spline.times[-1]

    def jet(t: float, within: float) -> Jet:
        """Displacement at ``t``, by the piece that holds at ``within``."""
        if within >= end:
            return np.array(spline.displacements[-1]), np.zeros(3), np.zeros(3)
        return curve(t), curve(t, 1), curve(t, 2)

    return jet
