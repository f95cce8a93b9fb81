"""Gains by which joints follow a plan."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from optim.planning.transcription.motion import Motion
from spacerobot.common.arrays import Array
from spacerobot.scene import Scene

BANDWIDTH = 5.0
"""Bandwidth of the joint PD that follows a plan, critically damped for the smallest inertia [rad/s]."""


def tracking_gains(motion: Motion, robot: str) -> dict[str, float]:
    """Gains ``kp`` and ``kd`` of a robot's joints, for the joint with the smallest inertia at the start."""
    scene = motion.problem.stage.scene
    # Accelerations per generalized force (nv x nv), with what rigid grasps hold moved along:
    # W - W A' (A W A')^-1 A W with W = M^-1 and A v the relative velocity that the grasps keep zero. An arm
    # that holds a heavy object moves its inertia with every joint, and needs gains for it.
    grips = motion.problem.stage.grips
    model, data = scene.model, scene.model.createData()
    q = np.array(motion.q[0] if grips else scene.q)
    mobility = np.triu(pin.computeMinverse(model, data, q))
    mobility += np.triu(mobility, 1).T
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    rows = list[Array]()
    for grasp in grips:
        tip, mate = (
            pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            for frame in (grasp.tip.frame, grasp.frame)
        )
        turns = scene.rotation_axes if grasp.config.holds_orientation else ()
        rows.append((tip - mate)[[*scene.translation_axes, *(3 + axis for axis in turns)]])
    if rows:
        slopes = np.vstack(rows)
        response = mobility @ slopes.T
        mobility = mobility - response @ np.linalg.pinv(slopes @ response) @ response.T
    columns = [scene.model.idx_vs[joint] for joint in scene.body(robot).driven_joints]
    least = 1 / float(max(mobility[column, column] for column in columns))
    return {"kp": float(f"{BANDWIDTH**2 * least:.3g}"), "kd": float(f"{2 * BANDWIDTH * least:.3g}")}


def base_gains(scene: Scene, robot: str) -> dict[str, float]:
    """Gains ``kd_linear`` and ``kd_angular`` of a robot's base, for the axes with the smallest inertia."""
    inverse = pin.computeMinverse(scene.model, scene.model.createData(), np.array(scene.q))
    root = scene.body(robot).root_joint
    first, size = int(scene.model.idx_vs[root]), int(scene.model.nvs[root])
    mobility = inverse.diagonal()[first : first + size]
    linear = size - (3 if size == 6 else 1)
    kinds = {"kd_linear": mobility[:linear], "kd_angular": mobility[linear:]}
    return {key: float(f"{BANDWIDTH / max(compliances):.3g}") for key, compliances in kinds.items()}
