"""Sensors of a robot, one for each signal that controllers may read."""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

from spacerobot.common.section import Section, quantity
from spacerobot.elements.sensors.signals import WRENCHES
from spacerobot.scenario.element_fields import Sensor


def signal(unit: str, description: str) -> Any:
    """Field of a signal's sensor; by default an ideal sensor, which is a linear sensor without errors."""
    return quantity(unit, description, default={"kind": "linear"}, validate_default=True)


class Sensors(Section):
    """Sensors of one robot, one for each signal that a controller feeds back."""

    joint_position: Sensor = signal("rad, m", "joint positions, used by the joint PD")
    joint_rate: Sensor = signal("rad/s, m/s", "joint rates, used by `feedback: base` and the joint PD")
    tip_position: Sensor = signal(
        "m", "tip positions from the world's origin, world axes, used by the amnesia controller"
    )
    tip_velocity: Sensor = signal("m/s", "tip velocities, world axes, used by `feedback: inertial`")
    tip_orientation: Sensor = signal(
        "rad", "rotation vector of tips relative to their references, world axes, for the amnesia controller"
    )
    tip_angular_velocity: Sensor = signal(
        "rad/s", "angular velocities of tips, world axes, used by `feedback: inertial`"
    )
    tip_force: Sensor = signal(
        "N",
        "force from outside on tips, world axes, used by force control (`impedance` with a desired inertia, "
        "`admittance`, `hybrid_force`)",
    )
    tip_torque: Sensor = signal(
        "N m", "torque from outside on tips about their origins, world axes, used by force control"
    )
    target_position: Sensor = signal(
        "m",
        "mating frames relative to tips, world axes, used by `rendezvous`, `mpc` and `target_filter`; a "
        "sample is held as the position of the mating frame from the world's origin",
    )
    target_velocity: Sensor = signal(
        "m/s", "velocities of mating frames, world axes, used by `rendezvous` and `mpc`"
    )
    target_orientation: Sensor = signal(
        "rad",
        "rotation vector from tips to mating frames, world axes, used by `mpc` and `target_filter`; a sample "
        "is held as an attitude in the world",
    )
    target_spin: Sensor = signal(
        "rad/s", "angular velocity of the target, world axes, used by `rendezvous` and `mpc`"
    )
    base_position: Sensor = signal(
        "m",
        "root link of a floating base from the world's origin, world axes, used by `mpc` and `base_position`",
    )
    base_orientation: Sensor = signal(
        "rad",
        "rotation vector of the root link since the start, world axes, used by `base_attitude`, `mpc` and "
        "`attitude_filter`; the filter holds a sample as an attitude",
    )
    base_velocity: Sensor = signal(
        "m/s", "velocity of the root link, world axes, used by `mpc` and `base_position`"
    )
    base_spin: Sensor = signal(
        "rad/s",
        "angular velocity of the root link, used by `mpc` and `base_attitude` (world axes) and by "
        "`attitude_filter` (axes of the root link)",
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
        sensor: Sensor = getattr(self, signal)
        return sensor
