"""Gains by which joints follow a plan."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacerobot.scene import Scene

BANDWIDTH = 5.0
"""[rad/s] Of the joint PD that follows a plan, critically damped at the joint that moves least inertia."""


def tracking_gains(scene: Scene, robot: str) -> dict[str, float]:
    """Gains ``kp`` and ``kd`` of a robot's joints, of a joint that moves least inertia where it begins."""
    inverse = pin.computeMinverse(scene.model, scene.model.createData(), np.array(scene.q))
    columns = [scene.model.idx_vs[joint] for joint in scene.body(robot).driven_joints]
    least = 1 / float(max(inverse[column, column] for column in columns))
    return {"kp": float(f"{BANDWIDTH**2 * least:.3g}"), "kd": float(f"{2 * BANDWIDTH * least:.3g}")}


def base_gains(scene: Scene, robot: str) -> dict[str, float]:
    """Gains ``kd_linear`` and ``kd_angular`` of a robot's base, of the axes along which it moves least."""
    inverse = pin.computeMinverse(scene.model, scene.model.createData(), np.array(scene.q))
    root = scene.body(robot).root_joint
    first, size = int(scene.model.idx_vs[root]), int(scene.model.nvs[root])
    mobility = inverse.diagonal()[first : first + size]
    linear = size - (3 if size == 6 else 1)
    kinds = {"kd_linear": mobility[:linear], "kd_angular": mobility[linear:]}
    return {key: float(f"{BANDWIDTH / max(own):.3g}") for key, own in kinds.items()}
