"""Sensors of a robot, written again."""

from __future__ import annotations

import functools

from spacerobot.elements import Sensor
from spacerobot.elements.sensors.linear_sensor import LinearSensor
from spacerobot.scenario import Robot
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import SceneBody
from tests.oracles.engine.laws import refusal


@functools.singledispatch
def reading_of(sensor: Sensor) -> LinearSensor:
    """Offset and scale of a sensor, of each kind."""
    raise refusal(sensor)


@reading_of.register
def _(sensor: LinearSensor) -> LinearSensor:
    return sensor


IDEAL = Sensors()
"""What a robot without sensors has."""


def sensors_of(body: SceneBody) -> Sensors:
    """Sensors of a robot, ideal ones if it has none."""
    return (body.config.sensors if isinstance(body.config, Robot) else None) or IDEAL
