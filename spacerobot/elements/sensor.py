"""Sensors of one robot (section 1.6 of the paper)."""

from __future__ import annotations

import casadi as ca
from pydantic import Field

from spacerobot.elements.context import Affine, Context
from spacerobot.section import SIGNALS_UNIT, Section, quantity


class Calibration(Section):
    """Linear sensor S = a + b s, the same for every component of the signal (section 1.6)."""

    offset: float = quantity(SIGNALS_UNIT, "a", default=0.0)
    scale: float = quantity("1", "b", default=1.0)


class Sensors(Section):
    """Sensors of one robot, one calibration for each signal that a controller feeds back."""

    joint_position: Calibration = quantity(
        "rad, m", "joint positions, used by the joint PD", default=Calibration()
    )
    joint_rate: Calibration = Field(
        default=Calibration(),
        description="joint rates [rad/s, m/s], used by `feedback: base` and the joint PD",
    )
    tip_position: Calibration = Field(
        default=Calibration(), description="tip positions [m], used by the amnesia controller"
    )
    tip_velocity: Calibration = Field(
        default=Calibration(), description="tip velocities [m/s], used by `feedback: inertial`"
    )
    tip_orientation: Calibration = Field(
        default=Calibration(),
        description="rotation vector of tips relative to their references [rad], for the amnesia controller",
    )
    tip_angular_velocity: Calibration = Field(
        default=Calibration(), description="angular velocities of tips [rad/s], used by `feedback: inertial`"
    )


def ideal(signal: str) -> Affine:
    """Sensor without error, which costs nothing."""
    del signal
    return None, ca.SX(1)


def calibrated(context: Context, signal: str) -> Affine:
    """Offset a and scale b of a signal, from the ``sensors`` section that the context stands at."""
    sensor = context.at(f"{context.path}.{signal}")
    return sensor.number("offset"), sensor.number("scale")


def measured(sensor: Affine, signal: ca.SX) -> ca.SX:
    """Signal as its sensor gives it: a + b s."""
    offset, scale = sensor
    return scale * signal if offset is None else offset + scale * signal
