"""Base class, axes and errors of the force and impedance controllers of a tip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import Section, quantity
from spacerobot.elements.controllers.controller import TipController, named_motion
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.sensors.signals import WRENCHES

Gain = Annotated[float, Field(ge=0)]
Gains = tuple[Gain, Gain, Gain]
PositiveGain = Annotated[float, Field(gt=0)]
PositiveGains = tuple[PositiveGain, PositiveGain, PositiveGain]
Axes = Literal["world", "reference"]


class ComplianceController(TipController):
    """A law of force, impedance or admittance for a tip's translation, or its rotation by its name."""

    @property
    def reads_wrench(self) -> bool:
        """Whether it reads the wrench on the tip."""
        return True

    def reads(self, key: str, siblings: Mapping[str, Section]) -> set[str]:
        """Pose and velocity of the motion that it controls, and the wrench if it reads it."""
        del siblings
        motion = {"tip_position", "tip_velocity"}
        if self.controls(key) == "rotation":
            motion = {"tip_orientation", "tip_angular_velocity"}
        return motion | (set(WRENCHES) if self.reads_wrench else set())

    def controls(self, key: str) -> Literal["translation", "rotation"]:
        """The tip's translation, or its rotation under a name that begins with ``orientation``."""
        return named_motion(key)


class ImpedanceLaw(ComplianceController):
    """A controller with a spring and a damper between a tip and its reference."""

    stiffness: Gains = quantity(
        "N/m", "stiffness along each of the axes", rotation="N m/rad", default=(0.0, 0.0, 0.0)
    )
    damping: Gains = quantity(
        "N s/m", "damping along each of the axes", rotation="N m s/rad", default=(0.0, 0.0, 0.0)
    )
    axes: Axes = Field(
        default="world",
        description="axes of stiffness, damping and inertia: those of the world or of the reference",
    )


def listed(*rows: Iterable[float]) -> str:
    """Rows of numbers in parentheses, separated by slashes, for :meth:`Element.words`."""
    return " / ".join(f"({', '.join(f'{value:g}' for value in row)})" for row in rows)


def gains_of(tip: TipContext, key: str, axes: Axes, *, inverse: bool = False) -> ca.SX:
    """Diagonal gain matrix (3x3) of the controller's section, rotated to world axes.

    Args:
        tip: The tip.
        key: Key of the three numbers.
        axes: Axes of the numbers: those of the world or of the tip's reference.
        inverse: Whether the matrix is inverted.
    """
    values = [tip.context.number(f"{key}.{i}") for i in range(3)]
    matrix = ca.diag(ca.vertcat(*(1 / value if inverse else value for value in values)))
    rotation = tip.motion.rotation
    return ca.mtimes([rotation, matrix, rotation.T]) if axes == "reference" else matrix


def read_pose_error(tip: TipContext, *, turns: bool) -> ca.SX:
    """Displacement or rotation vector from the tip to its reference (3x1), as sensors give it [m or rad]."""
    if turns:
        return -tip.read("tip_orientation", -tip.orientation_error)
    return tip.motion.position - tip.read("tip_position", tip.position)


def read_rate_error(tip: TipContext, *, turns: bool) -> ca.SX:
    """Velocity of the reference minus that of the tip (3x1), as sensors give it [m/s or rad/s]."""
    if turns:
        return tip.motion.angular_velocity - tip.read("tip_angular_velocity", tip.angular_velocity)
    return tip.motion.velocity - tip.read("tip_velocity", tip.velocity)


def reference_acceleration(tip: TipContext, *, turns: bool) -> ca.SX:
    """Linear or angular acceleration of the reference (3x1) [m/s^2 or rad/s^2]."""
    return tip.motion.angular_acceleration if turns else tip.motion.acceleration
