"""Rotations of the object and of the bases since the start."""

from __future__ import annotations

import numpy as np

from spacerobot.quantities.quantity import Columns, Quantity, SignalSource, sizes

SMALLEST = np.radians(1e-9)  # keeps the angle smooth where a body has not turned
NO_TARGET = "this scene has no target"


def of_target(source: SignalSource) -> Columns:
    """Rotation of the object [deg]."""
    return sizes(source.signal("target_rotation"), SMALLEST, 180 / np.pi)


def of_bases(source: SignalSource) -> Columns:
    """Rotation of each robot's base [deg]."""
    return sizes(source.signal("base_rotation"), SMALLEST, 180 / np.pi)


QUANTITIES = (
    Quantity(
        "target_rotation_peak",
        "peak object rotation",
        "largest rotation of the object since the start",
        "deg",
        "peak",
        of_target,
        limit="target_rotation_deg",
        absent=NO_TARGET,
        symbol="R",
    ),
    Quantity(
        "base_rotation_peak",
        "peak base rotation",
        "largest rotation of a base since the start",
        "deg",
        "peak",
        of_bases,
        limit="base_rotation_deg",
        absent="this scene has no robot",
        symbol="B",
    ),
    Quantity(
        "target_rotation_rms",
        "RMS object rotation",
        "root mean square of the object's rotation since the start",
        "rad",
        "rms",
        "target_rotation",
        total="norm",
        weight="object_rotation",
        is_default=False,
        absent=NO_TARGET,
    ),
    Quantity(
        "base_rotation_rms",
        "RMS base rotation",
        "root mean square of the rotation of a base since the start",
        "rad",
        "rms",
        "base_rotation",
        total="norm",
        weight="base_rotation",
        cost="base_rotation",
        relative_to_start=True,
        is_default=False,
        absent="there are no floating bases of robots",
    ),
)
