"""Motions as expressions of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from spacerobot.elements.core.section_context import SectionContext


@dataclass(frozen=True)
class DesiredMotion:
    """Desired pose and motion of a frame, world axes.

    Attributes:
        position, velocity, acceleration: Motion of the frame's origin, 3x1 each [m, m/s, m/s^2].
        rotation: Frame axes to world axes, 3x3.
        angular_velocity, angular_acceleration: 3x1 each [rad/s, rad/s^2].
    """

    position: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    rotation: ca.SX
    angular_velocity: ca.SX
    angular_acceleration: ca.SX


@dataclass(frozen=True)
class InitialMotion:
    """Pose and motion of a frame at the instant at which a reference becomes active, world axes.

    Attributes:
        rotation: Frame axes to world axes (3x3).
        origin: Origin of the frame (3x1) [m].
        twist: Function that returns its velocity and spin (3x1 each) [m/s, rad/s]; stored only if called.
        keep: Function from a name and an expression of the state to its value at that instant, of the same
            shape.
    """

    rotation: ca.SX
    origin: ca.SX
    twist: Callable[[], tuple[ca.SX, ca.SX]]
    keep: Callable[[str, ca.SX], ca.SX]

    @property
    def velocity(self) -> ca.SX:
        """Velocity of the frame's origin (3x1) [m/s]."""
        return self.twist()[0]

    @property
    def angular_velocity(self) -> ca.SX:
        """Angular velocity of the frame (3x1) [rad/s]."""
        return self.twist()[1]


@dataclass(frozen=True)
class TimeProfile:
    """A scalar or vector function of time with its first two derivatives."""

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX


STILL = TimeProfile(ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1))
"""Profile of a vector that stays zero."""


def cubic_blend(context: SectionContext, key: str = "duration") -> TimeProfile:
    """Cubic blend from 0 to 1, at rest at both ends and constant afterwards (Eq. 42).

    Args:
        context: Time, and the numbers of the section.
        key: Key of the blend's duration in the section [s].
    """
    duration = context.number(key)
    moving = context.time < context.jump(key)
    s = ca.if_else(moving, context.time / duration, 1)
    return TimeProfile(
        value=s * s * (3 - 2 * s),
        rate=6 * s * (1 - s) / duration,
        acceleration=ca.if_else(moving, (6 - 12 * s) / duration**2, 0),
    )


def smooth_blend(
    context: SectionContext, keys: tuple[str | None, str], begin: ca.SX, duration: ca.SX
) -> TimeProfile:
    """Profile from 0 to 1, with zero velocity and acceleration at both ends, between two instants.

    Args:
        context: Time.
        keys: Names of the two instants; none for the beginning of the law.
        begin, duration: Start time and duration, expressions of the section's numbers (1x1 each) [s].
    """
    is_started = ca.SX(1) if keys[0] is None else context.time >= context.jump(keys[0], begin)
    moving = ca.logic_and(is_started, context.time < context.jump(keys[1], begin + duration))
    s = ca.if_else(moving, (context.time - begin) / duration, ca.if_else(is_started, 1, 0))
    return TimeProfile(
        value=s**3 * (10 - 15 * s + 6 * s * s),
        rate=30 * (s * (1 - s)) ** 2 / duration,
        acceleration=60 * s * (1 - s) * (1 - 2 * s) / duration**2,
    )


def along(direction: ca.SX, blend: TimeProfile) -> TimeProfile:
    """A constant vector (n x 1), carried by a scalar profile."""
    return TimeProfile(direction * blend.value, direction * blend.rate, direction * blend.acceleration)
