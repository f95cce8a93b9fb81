"""Violations of the URDFs' joint limits on position, rate and torque, which rollouts do not enforce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

ROUNDING = 1e-6
"""Excess that counts as rounding, relative to the range, the rate or the torque."""
QUANTITIES = {
    "position": ("joint_position", np.degrees(1.0), ("deg", "m")),
    "rate": ("joint_velocity", np.degrees(1.0), ("deg/s", "m/s")),
    "torque": ("joint_torque", 1.0, ("N m", "N")),
}
"""Variable of each quantity, factor for revolute joints, and units for revolute and prismatic joints."""


def beyond_limits(scene: Scene, data: xr.Dataset) -> list[dict[str, Any]]:
    """Find joints that violate the limits of position, rate and torque in their URDFs.

    Args:
        scene: The scene.
        data: Dataset of the complete rollout.

    Returns:
        list of dict: Violations with ``joint``, ``quantity``, ``unit``, the violated ``limit``, ``from_s``
            (time of the first violation), the maximum ``excess`` and its time ``time_s``.
    """
    labels, time = [str(joint) for joint in data["joint"].values], data["time"].values
    violations = []
    for body in scene.bodies:
        for joint in body.description.joints:
            label = f"{body.name}/{joint.name}"
            if label not in labels:
                continue
            # quantities with limits in the URDF, where an effort or velocity of 0 means no limit
            ranges = list[tuple[str, float, float]]()
            if joint.kind != "continuous" and np.isfinite((joint.lower, joint.upper)).any():
                ranges.append(("position", joint.lower, joint.upper))
            for quantity, largest in (("rate", joint.velocity), ("torque", joint.effort)):
                if 0 < largest < np.inf:
                    ranges.append((quantity, -largest, largest))
            for quantity, lower, upper in ranges:
                name, factor, units = QUANTITIES[quantity]
                slides = joint.kind == "prismatic"
                values: Array = data[name].values[:, labels.index(label)]
                below, above = lower - values, values - upper
                excess = np.maximum(below, above)
                k = int(np.argmax(excess))
                size = upper - lower if np.isfinite(upper - lower) else max(abs(upper), abs(lower))
                if not excess[k] > ROUNDING * size:
                    continue
                scale = 1.0 if slides else factor
                violations.append(
                    {
                        "joint": label,
                        "quantity": quantity,
                        "unit": units[slides],
                        "limit": float((lower if below[k] > above[k] else upper) * scale),
                        "from_s": float(time[int(np.argmax(excess > ROUNDING * size))]),
                        "excess": float(excess[k] * scale),
                        "time_s": float(time[k]),
                    }
                )
    return violations


def limit_warnings(violations: Sequence[Mapping[str, Any]]) -> list[str]:
    """Warnings, one for each robot and quantity, with the largest relative excess first."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for one in violations:
        groups.setdefault((one["joint"].partition("/")[0], one["quantity"]), []).append(one)
    texts = []
    for (_, quantity), joints in groups.items():
        ordered = sorted(joints, key=lambda one: -one["excess"] / max(abs(one["limit"]), 1e-9))
        lines = [
            f"{one['joint']} from {one['from_s']:.4g} s on, by up to {one['excess']:.3g} {one['unit']} "
            f"beyond {one['limit']:.4g} {one['unit']} (at {one['time_s']:.4g} s)"
            for one in ordered[:3]
        ]
        more = [f"{len(ordered) - 3} more"] if len(ordered) > 3 else []
        texts.append(
            f"joint {quantity} beyond the URDF's limits, which are not enforced: {'; '.join([*lines, *more])}"
        )
    return texts
