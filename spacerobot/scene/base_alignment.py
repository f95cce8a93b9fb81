"""Rotation of a base such that its grasp starts aligned.

Quaternions x, y, z, w of numbers or CasADi symbols. They are products of half-angle quaternions along the
chain of joints and are never extracted from a matrix, so they depend smoothly on all parameters without sign
jumps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.scene.grasp_closing import ClosingBase

Quaternion = Sequence[Any]
NOISE = 1e-14  # of a constant quaternion's entries


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def inverse(quaternion: Quaternion) -> Quaternion:
    """The opposite turn."""
    x, y, z, w = quaternion
    return -x, -y, -z, w


def rpy(cosines: Sequence[Any], sines: Sequence[Any]) -> Quaternion:
    """Rotation by roll, pitch, yaw, from the cosines and sines of their halves."""
    roll, pitch, yaw = (
        [sine * (i == axis) for i in range(3)] + [cosine]
        for axis, (cosine, sine) in enumerate(zip(cosines, sines, strict=True))
    )
    return product(yaw, product(pitch, roll))


def joint(model: Any, index: int, cosine: Any, sine: Any) -> Quaternion:
    """Placement by a joint of one degree of freedom, from the cosine and sine of half its position."""
    model_joint = model.joints[index]
    data = model_joint.createData()
    model_joint.calc(data, pin.neutral(model))
    axis = np.asarray(data.S, dtype=float).reshape(6, model_joint.nv)[3:, 0]
    return (*(float(a) * sine for a in axis), cosine) if axis.any() else (0.0, 0.0, 0.0, 1.0)


def aligned(
    model: Any, closing: ClosingBase, turns: Mapping[int, Quaternion], offset: Quaternion
) -> Quaternion:
    """Rotation of a closing's base for which its tip starts rotated by ``offset`` in the mating frame.

    Args:
        model: The scene's model.
        closing: Base to rotate, and grasp to align.
        turns: Rotation of every other joint that the grasp depends on, by joint id.
        offset: Rotation from tip axes to the mating frame's axes.
    """
    root = closing.body.root_joint
    present, other = (_frame(model, frame, turns, root) for frame in (closing.own, closing.other))
    desired = product(other, inverse(offset) if closing.body.name == "target" else offset)
    return product(desired, inverse(present))


def upright(turn: Quaternion, length: Any) -> Quaternion:
    """Nearest rotation about z; ``length`` is the norm of its z and w, 1 for a rotation about z."""
    return 0.0, 0.0, turn[2] / length, turn[3] / length


def _frame(model: Any, frame: int, turns: Mapping[int, Quaternion], root: int) -> Quaternion:
    """Placement of a frame in the world, or in the body of the joint ``root`` if the frame is fixed to it."""
    supports = list(model.supports[model.frames[frame].parentJoint])
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    for index in supports[supports.index(root) + 1 if root in supports else 1 :]:
        orientation = product(product(orientation, _constant(model.jointPlacements[index])), turns[index])
    return product(orientation, _constant(model.frames[frame].placement))


def _constant(placement: Any) -> Quaternion:
    """Constant placement, without rounding noise."""
    values = pin.Quaternion(placement.rotation).coeffs()
    return tuple(float(value) if abs(value) > NOISE else 0.0 for value in values)
