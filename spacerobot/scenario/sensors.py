"""The sensors of a robot, one for each signal that a controller may read."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from spacerobot.elements import Family, Sensor, create
from spacerobot.elements.sensors.signals import WRENCHES
from spacerobot.section import Section, quantity

AnySensor = Annotated[Sensor, Family("sensor", default="linear")]
IDEAL: Sensor = create("sensor", "linear")
"""A sensor without errors."""


class Sensors(Section):
    """Sensors of one robot, one for each signal that a controller feeds back."""

    joint_position: AnySensor = quantity("rad, m", "joint positions, used by the joint PD", default=IDEAL)
    joint_rate: AnySensor = quantity(
        "rad/s, m/s", "joint rates, used by `feedback: base` and the joint PD", default=IDEAL
    )
    tip_position: AnySensor = quantity(
        "m",
        "tip positions from the world's origin, world axes, used by the amnesia controller",
        default=IDEAL,
    )
    tip_velocity: AnySensor = quantity(
        "m/s", "tip velocities, world axes, used by `feedback: inertial`", default=IDEAL
    )
    tip_orientation: AnySensor = quantity(
        "rad",
        "rotation vector of tips relative to their references, world axes, for the amnesia controller",
        default=IDEAL,
    )
    tip_angular_velocity: AnySensor = quantity(
        "rad/s", "angular velocities of tips, world axes, used by `feedback: inertial`", default=IDEAL
    )
    tip_force: AnySensor = quantity(
        "N",
        "force from outside on tips, world axes, used by force control (`impedance` with a desired inertia, "
        "`admittance`, `hybrid_force`)",
        default=IDEAL,
    )
    tip_torque: AnySensor = quantity(
        "N m",
        "torque from outside on tips about their origins, world axes, used by force control",
        default=IDEAL,
    )
    target_position: AnySensor = quantity(
        "m",
        "mating frames relative to tips, world axes, used by `rendezvous`, `mpc` and `target_filter`; a "
        "sample is held as the position of the mating frame from the world's origin",
        default=IDEAL,
    )
    target_velocity: AnySensor = quantity(
        "m/s", "velocities of mating frames, world axes, used by `rendezvous` and `mpc`", default=IDEAL
    )
    target_orientation: AnySensor = quantity(
        "rad",
        "rotation vector from tips to mating frames, world axes, used by `mpc` and `target_filter`; a sample "
        "is held as an attitude in the world",
        default=IDEAL,
    )
    target_spin: AnySensor = quantity(
        "rad/s", "angular velocity of the target, world axes, used by `rendezvous` and `mpc`", default=IDEAL
    )
    base_position: AnySensor = quantity(
        "m",
        "root link of a floating base from the world's origin, world axes, used by `mpc` and `base_position`",
        default=IDEAL,
    )
    base_orientation: AnySensor = quantity(
        "rad",
        "rotation vector of the root link since the start, world axes, used by `base_attitude`, `mpc` and "
        "`attitude_filter`; the filter holds a sample as an attitude",
        default=IDEAL,
    )
    base_velocity: AnySensor = quantity(
        "m/s", "velocity of the root link, world axes, used by `mpc` and `base_position`", default=IDEAL
    )
    base_spin: AnySensor = quantity(
        "rad/s",
        "angular velocity of the root link, used by `mpc` and `base_attitude` (world axes) and by "
        "`attitude_filter` (axes of the root link)",
        default=IDEAL,
    )

    @model_validator(mode="after")
    def _check(self) -> Sensors:
        for signal, sensor in self:
            if signal.startswith("joint_") and sensor.errors and any(sensor.errors.misalignment_deg):
                raise ValueError(f"{signal}.errors.misalignment_deg: found one, allowed for joints: none")
            if sensor.reads_motors and not signal.startswith("joint_"):
                raise ValueError(f"{signal}.side: found motor, allowed for what is no joint: link")
            if sensor.measures_wrench and signal not in WRENCHES:
                raise ValueError(
                    f"{signal}.kind: found {sensor.kind}, allowed for {', '.join(WRENCHES)} only"
                )
        return self

    def __getitem__(self, signal: str) -> Sensor:
        """Sensor of a signal."""
        found: Sensor = getattr(self, signal)
        return found
