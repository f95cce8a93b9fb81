"""Rotations of the target and of the bases since the start."""

from __future__ import annotations

import numpy as np

from spacerobot.quantities.quantity import Columns, PlanBound, Quantity, SignalSource, sizes

SMALLEST = np.radians(1e-9)  # keeps the angle smooth where a body has not turned
NO_TARGET = "this scene has no target"


def of_target(source: SignalSource) -> Columns:
    """Rotation of the target since the start [deg]."""
    return sizes(source.signal("target_rotation"), SMALLEST, 180 / np.pi)


def of_bases(source: SignalSource) -> Columns:
    """Rotation of each robot's base since the start [deg]."""
    return sizes(source.signal("base_rotation"), SMALLEST, 180 / np.pi)


QUANTITIES = (
    Quantity(
        name="target_rotation_peak",
        label="peak object rotation",
        description="largest rotation of the object since the start",
        unit="deg",
        reducer="peak",
        expression=of_target,
        limit="target_rotation_deg",
        absent=NO_TARGET,
        symbol="R",
    ),
    Quantity(
        name="base_rotation_peak",
        label="peak base rotation",
        description="largest rotation of a base since the start",
        unit="deg",
        reducer="peak",
        expression=of_bases,
        limit="base_rotation_deg",
        absent="this scene has no robot",
        symbol="B",
    ),
    Quantity(
        name="target_rotation_rms",
        label="RMS object rotation",
        description="root mean square of the object's rotation since the start",
        unit="rad",
        reducer="rms",
        expression="target_rotation",
        total="norm",
        weight="object_rotation",
        is_default=False,
        absent=NO_TARGET,
    ),
    Quantity(
        name="base_rotation_rms",
        label="RMS base rotation",
        description="root mean square of the rotation of a base since the start",
        unit="rad",
        reducer="rms",
        expression="base_rotation",
        total="norm",
        weight="base_rotation",
        cost="base_rotation",
        bounds=(
            PlanBound(
                "base_rotation_deg",
                "deg",
                "maximum rotation of any robot's base since the start",
                allowed={"gt": 0, "lt": 180},
            ),
        ),
        relative_to_start=True,
        is_default=False,
        absent="there are no floating bases of robots",
    ),
)
