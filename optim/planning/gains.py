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
