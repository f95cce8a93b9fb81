"""Sensors: readings of signals for controllers (section 1.6 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
from pydantic import Field

from spacerobot.common.registry import required
from spacerobot.elements.core.context import Affine
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.sensors.measurement import (
    Measurement,
    Observation,
    SensorErrors,
    SensorFailure,
    misalignment,
)


@dataclass(frozen=True)
class Flange:
    """Location of a force-torque sensor.

    Attributes:
        joint: Name of the joint in the URDF, fixed or not, that transmits the measured wrench; None for the
            tip, beyond which there is no link.
        compensated: Whether weight and inertia of the links beyond it are subtracted.
    """

    joint: str | None = None
    compensated: bool = True


class Sensor(Element):
    """Sensor of one signal, the same for every component; its reading is linear in the signal.

    Attributes:
        holds: Whether it measures once per ``period`` [s] and holds the measurement.
    """

    family: ClassVar[str] = "sensor"
    holds: ClassVar[bool] = False
    errors: SensorErrors | None = Field(
        default=None,
        description="sampling, latency and noise: `period`, `delay`, `noise`, `noise_growth`, `bias`, "
        "`bias_walk`, `resolution`, `dropout`, `range`, `misalignment_deg`; continuous and without noise if "
        "not given",
    )

    failure: SensorFailure | None = Field(
        default=None, description="it freezes, drifts or is lost, `at` a time"
    )

    def measurement(self, name: str, context: SectionContext, observed: Observation) -> Measurement | None:
        """Sampled measurement of a signal (n x 1); None if it is continuous and does not fail.

        Args:
            name: Unique in the closed loop.
            context: Context of the sensor's section.
            observed: Present observation, by :meth:`aligned` and :meth:`affine`.
        """
        failing = None
        if self.failure is not None:
            failing = self.failure.build(context.at(f"{context.path}.failure"), name)
        if self.errors is not None:
            errors_context = context.at(f"{context.path}.errors")
            return Measurement.of(name, errors_context, self.errors, observed, failing)
        if self.holds:
            return Measurement.held(name, context, observed.reading, failing)
        return None if failing is None else Measurement.failing(name, observed.reading, failing)

    def aligned(self, context: SectionContext, value: ca.SX, axes: ca.SX | None) -> ca.SX:
        """Signal as measured in a sensor's misaligned axes.

        Args:
            context: Context of the sensor's section.
            value: Vector (3x1), or attitude (3x3).
            axes: Axes of the link that carries the sensor, in those of the signal (3x3); None for an
                attitude.
        """
        turn = None if self.errors is None else misalignment(context.at(f"{context.path}.errors"))
        if turn is None:
            return value
        if axes is None:
            return ca.mtimes(
                value, turn
            )  # the attitude of the sensor's axes is taken for that of the carrier
        return ca.mtimes(axes, ca.mtimes(turn.T, ca.mtimes(axes.T, value)))

    @required()
    def affine(self, context: SectionContext) -> Affine:
        """Offset a and scale b of the reading a + b s."""
        raise NotImplementedError

    @property
    def reads_motors(self) -> bool:
        """Whether it is mounted on the joints' motors, on the motor side of their transmissions."""
        return False

    @property
    def measures_wrench(self) -> bool:
        """Whether it measures only forces and torques."""
        return False

    @property
    def flange(self) -> Flange:
        """Place at which it measures the wrench on a tip; at the tip itself by default."""
        return Flange()

    @property
    @required()
    def is_ideal(self) -> bool:
        """Whether it reads the exact signal."""
        raise NotImplementedError


def ideal(signal: str) -> Affine:
    """Offset and scale of an error-free sensor, without operations in the loop."""
    del signal
    return None, ca.SX(1)


def measured(sensor: Affine, signal: ca.SX) -> ca.SX:
    """Signal as its sensor gives it: a + b s."""
    offset, scale = sensor
    return scale * signal if offset is None else offset + scale * signal
