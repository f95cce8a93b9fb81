"""Signals of sensors: units and frames."""

from __future__ import annotations

from typing import NamedTuple


class MeasuredSignal(NamedTuple):
    """Unit of a signal, and meaning and frame of its measured value."""

    unit: str
    text: str


SIGNALS: dict[str, MeasuredSignal] = {
    "joint_position": MeasuredSignal("rad or m", "positions of joints"),
    "joint_rate": MeasuredSignal("rad/s or m/s", "rates of joints"),
    "tip_position": MeasuredSignal("m", "position of tips from the world's origin, world axes"),
    "tip_velocity": MeasuredSignal("m/s", "velocity of tips, world axes"),
    "tip_orientation": MeasuredSignal("rad", "rotation vector from references to tips, world axes"),
    "tip_angular_velocity": MeasuredSignal("rad/s", "angular velocity of tips, world axes"),
    "tip_force": MeasuredSignal("N", "force on tips, world axes"),
    "tip_torque": MeasuredSignal("N m", "torque on tips about their origins, world axes"),
    "target_position": MeasuredSignal("m", "position of mating frames from the world's origin, world axes"),
    "target_velocity": MeasuredSignal("m/s", "velocity of mating frames, world axes"),
    "target_orientation": MeasuredSignal("rad", "rotation vector of the target since the start, world axes"),
    "target_spin": MeasuredSignal("rad/s", "angular velocity of the target, world axes"),
    "base_position": MeasuredSignal("m", "position of root links from the world's origin, world axes"),
    "base_orientation": MeasuredSignal("rad", "rotation vector of root links since the start, world axes"),
    "base_velocity": MeasuredSignal("m/s", "velocity of root links, world axes"),
    "base_spin": MeasuredSignal("rad/s", "angular velocity of root links, world axes"),
    "base_spin_body": MeasuredSignal("rad/s", "angular velocity of root links, axes of the root links"),
}
"""Signals by name, in the frames in which controllers, references and estimators sample them."""
WRENCHES = ("tip_force", "tip_torque")
"""Signals of force-torque sensors."""
BODY_AXES = "_body"
"""Suffix of the names of signals in the axes of the link that carries the sensor."""
MEASURED = "measured_"
"""Prefix of the names of outputs that show what sensors with errors measure."""
