"""Frames in motion, by Pinocchio's own algorithms; everything in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array

_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class FrameMotion:
    """A frame at one instant.

    Attributes
    ----------
    rotation, position
        (3, 3) and (3,) [m].
    velocity
        Of its origin, then angular (6,) [m/s, rad/s].
    drift
        Acceleration at zero joint acceleration, classical, then angular (6,).
    jacobian, jacobian_rate
        (6, nv) each, linear rows first.
    """

    rotation: Array
    position: Array
    velocity: Array
    drift: Array
    jacobian: Array
    jacobian_rate: Array


class Kinematics:
    """Frames of a model at one configuration and velocity, computed when first asked for."""

    def __init__(self, model: Any, q: Array, v: Array) -> None:
        self.model, self.q, self.v = model, q, v
        self.data = model.createData()
        pin.computeJointJacobiansTimeVariation(model, self.data, q, v)
        pin.forwardKinematics(model, self.data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, self.data)
        self._frames: dict[int, FrameMotion] = {}

    def frame(self, index: int) -> FrameMotion:
        """Motion of a frame."""
        if index not in self._frames:
            model, data, placement = self.model, self.data, self.data.oMf[index]
            self._frames[index] = FrameMotion(
                np.array(placement.rotation),
                np.array(placement.translation),
                np.array(pin.getFrameVelocity(model, data, index, _AXES).vector),
                np.array(pin.getFrameClassicalAcceleration(model, data, index, _AXES).vector),
                pin.getFrameJacobian(model, data, index, _AXES),
                pin.getFrameJacobianTimeVariation(model, data, index, _AXES),
            )
        return self._frames[index]

    def local_wrench(self, joint: int, force: Array, torque: Array, point: Array) -> Any:
        """Wrench on a joint's body, from a force and a torque at a point, in the joint's own axes."""
        at_origin = pin.Force(force, torque + cross(point, force))
        return self.data.oMi[joint].actInv(at_origin)


def joint_space_inertia(kinematics: Kinematics) -> Array:
    """Joint space inertia (nv, nv), by the composite-rigid-body algorithm."""
    model = kinematics.model
    upper = np.triu(pin.crba(model, model.createData(), kinematics.q))
    inertia: Array = upper + np.triu(upper, 1).T
    return inertia


def cross(a: Array, b: Array) -> Array:
    """Vector product (3,); several times faster than numpy's for single vectors."""
    product: Array = pin.skew(a) @ b
    return product


def rotation_vector(wanted: Array, found: Array) -> Array:
    """Rotation vector (3,), world axes, that turns ``found`` into ``wanted`` [rad]."""
    vector: Array = pin.log3(wanted @ found.T)
    return vector


def coordinates(model: Any) -> list[tuple[slice, slice]]:
    """Places of each joint's coordinates in q and v."""
    return [
        (slice(joint.idx_q, joint.idx_q + joint.nq), slice(joint.idx_v, joint.idx_v + joint.nv))
        for joint in list(model.joints)[1:]
    ]


def configuration_rate(places: Sequence[tuple[slice, slice]], q: Array, v: Array) -> Array:
    """Time derivative of Pinocchio's coordinates (nq,), joint by joint; q need not be normalised."""
    rate: Array = np.concatenate([_joint_rate(q[own], v[speed]) for own, speed in places])
    return rate


def _joint_rate(q: Array, v: Array) -> Array:
    if len(q) == len(v):
        return v
    if len(q) == 2:  # cos, sin
        return np.array([-q[1] * v[0], q[0] * v[0]])
    if len(q) == 4:  # x, y, cos, sin; velocity in the body's axes
        cos, sin = q[2:] / np.hypot(q[2], q[3])
        return np.array([cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], -q[3] * v[2], q[2] * v[2]])
    quaternion = pin.Quaternion(q[3:] / np.linalg.norm(q[3:]))
    turned = quaternion * pin.Quaternion(np.array([*v[3:], 0.0]))
    length = np.linalg.norm(q[3:])
    rate: Array = np.concatenate([quaternion.toRotationMatrix() @ v[:3], 0.5 * length * turned.coeffs()])
    return rate
