"""Placements of all joints of a scene at many configurations at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from spacerobot.common.arrays import Array
from spacerobot.dynamics.joints import JointKind, JointModel
from spacerobot.scene import Scene


@dataclass(frozen=True, eq=False)
class JointPlacements:
    """Placements of all joints' frames in the world at some configurations, the universe's first.

    Attributes:
        rotation: Rotations from joint to world axes (nt, joints, 3, 3).
        origin: Origins of the joint frames (nt, joints, 3) [m].
    """

    rotation: Array
    origin: Array

    def points(self, joint: int, point: Array) -> Array:
        """World places (nt, 3) [m] of a point (3,) that is fixed to a joint's frame."""
        return self.origin[:, joint] + self.rotation[:, joint] @ point


def joint_placements(scene: Scene, joints: Sequence[JointModel], q: Array) -> JointPlacements:
    """Placements of all joints of a scene's model at configurations q (nt, nq), all at once."""
    model = scene.model
    rotation, origin = np.zeros((model.njoints, len(q), 3, 3)), np.zeros((model.njoints, len(q), 3))
    rotation[0] = np.eye(3)
    # origins (nt, 3) [m] and rotation vectors (nt, 3) [rad] of the joints' moved frames in their rest
    # frames
    places, vectors = np.zeros((len(joints), len(q), 3)), np.zeros((len(joints), len(q), 3))
    for joint, place, vector in zip(joints, places, vectors, strict=True):
        coordinates = q[:, joint.idx_q : joint.idx_q + joint.nq]
        if joint.kind is JointKind.FREE_FLYER:
            place[:], vector[:] = coordinates[:, :3], Rotation.from_quat(coordinates[:, 3:]).as_rotvec()
        elif joint.kind is JointKind.PRISMATIC:
            place[:] = coordinates * np.array(ca.DM(joint.linear)).T
        else:
            if joint.kind is JointKind.PLANAR:
                place[:, :2] = coordinates[:, :2]
            angle = (
                coordinates[:, 0]
                if joint.kind is JointKind.REVOLUTE
                else np.arctan2(coordinates[:, -1], coordinates[:, -2])
            )
            vector[:] = angle[:, None] * np.array(ca.DM(joint.angular))[:, -1]
    # of all joints at once, which is faster
    turns = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)
    for joint, place, turned in zip(joints, places, turns, strict=True):
        resting, before = model.jointPlacements[joint.index], rotation[joint.parent]
        offset = resting.translation + place @ resting.rotation.T
        origin[joint.index] = origin[joint.parent] + np.einsum("tij,tj->ti", before, offset)
        joint_rotation = (before.reshape(-1, 3) @ resting.rotation).reshape(
            -1, 3, 3
        )  # faster than a stack's product
        rotation[joint.index] = joint_rotation @ turned
    return JointPlacements(rotation.swapaxes(0, 1), origin.swapaxes(0, 1))


def quaternions(rotation: Array) -> Array:
    """Unit quaternions (..., 4), x, y, z, w, of rotation matrices (..., 3, 3).

    The quaternion is the normalised row, with the largest diagonal entry, of the matrix 4 q q^T.
    """
    products = np.empty((*rotation.shape[:-2], 4, 4))
    trace = np.trace(rotation, axis1=-2, axis2=-1)
    products[..., :3, :3] = rotation + rotation.swapaxes(-1, -2)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        products[..., i, i] += 1 - trace
        products[..., i, 3] = products[..., 3, i] = rotation[..., k, j] - rotation[..., j, k]
    products[..., 3, 3] = 1 + trace
    greatest = np.einsum("...ii->...i", products).argmax(axis=-1)
    largest = np.take_along_axis(products, greatest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(largest / np.sqrt((largest**2).sum(axis=-1, keepdims=True)))
