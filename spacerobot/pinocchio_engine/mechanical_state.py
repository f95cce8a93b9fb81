"""Mechanics at one state from Pinocchio's own algorithms, world axes."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements import CollisionShape
from spacerobot.pinocchio_engine.crowned_distance import shape_distance
from spacerobot.scene.scene import SceneShape
from spacerobot.shapes import Shape, core_radius

_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class FrameMotion:
    """Motion of a frame, or of a joint's frame, at one instant.

    Attributes:
        rotation, position: Rotation (3, 3) and position (3,) [m].
        velocity: Linear velocity of the origin, then angular velocity (6,) [m/s, rad/s].
        drift: Classical acceleration at zero joint acceleration, then angular acceleration (6,) [m/s^2,
            rad/s^2].
        jacobian, jacobian_rate: (6, nv) each, linear rows first.
    """

    rotation: Array
    position: Array
    velocity: Array
    drift: Array
    jacobian: Array
    jacobian_rate: Array


class MechanicalState:
    """Kinematics and dynamics of a model at one configuration and velocity, computed on first use.

    Args:
        model: The scene's ``pinocchio.Model``.
        q, v: Configuration (nq,), which is normalised, and velocity (nv,).
        scratch: ``pinocchio.Data`` for results that are copied at once; a new one if None. Its creation takes
            ten times as long as the algorithms themselves.
    """

    def __init__(self, model: Any, q: Array, v: Array, scratch: Any = None) -> None:
        self.model, self.q, self.v = model, pin.normalize(model, q), v
        self._given_scratch = scratch
        self.data = model.createData()
        pin.computeJointJacobiansTimeVariation(model, self.data, self.q, v)
        pin.forwardKinematics(model, self.data, self.q, v, np.zeros(model.nv))
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

    def joint_velocity(self, joint: int) -> Array:
        """Linear velocity of a joint frame's origin, then angular velocity (6,) [m/s, rad/s]."""
        return np.array(pin.getVelocity(self.model, self.data, joint, _AXES).vector)

    def joint_jacobian(self, joint: int) -> Array:
        """Jacobian of a joint frame (6, nv), linear rows first."""
        jacobian: Array = pin.getJointJacobian(self.model, self.data, joint, _AXES)
        return jacobian

    @functools.cached_property
    def _scratch(self) -> Any:
        return self.model.createData() if self._given_scratch is None else self._given_scratch

    @functools.cached_property
    def inertia(self) -> Array:
        """Joint-space inertia (nv, nv), by the composite-rigid-body algorithm."""
        upper = np.triu(pin.crba(self.model, self._scratch, self.q))
        matrix: Array = upper + np.triu(upper, 1).T
        return matrix

    @functools.cached_property
    def _newton_euler(self) -> Any:
        data = self.model.createData()
        pin.rnea(self.model, data, self.q, self.v, np.zeros(self.model.nv))
        return data

    @property
    def bias(self) -> Array:
        """Generalized forces of gravity, centrifugal and Coriolis accelerations (nv,)."""
        return np.array(self._newton_euler.tau)

    def inertia_force(self, root: int) -> Array:
        """Force and torque (6,) that move the subtree after a joint as at zero joint acceleration.

        The recursive Newton-Euler algorithm gives the wrench that the joint carries, in the joint's axes.
        """
        rotation, carried = self.data.oMi[root].rotation, self._newton_euler.f[root]
        return np.concatenate([rotation @ carried.linear, rotation @ carried.angular])

    def free_acceleration(self, effort: Array) -> Array:
        """Acceleration (nv,) under generalized forces (nv,), by the articulated-body algorithm."""
        return np.array(pin.aba(self.model, self._scratch, self.q, self.v, effort))

    def proximity(self, pair: tuple[SceneShape, SceneShape], crown: float) -> Array:
        """Gap [m], normal and midpoint of the witness points [m] of two shapes (7,)."""
        places = [pin.SE3(f.rotation, f.position) for f in (self.frame(shape.frame) for shape in pair)]
        gap, normal, point = shape_distance(pair, places, crown)
        return np.concatenate([[gap], normal, point])

    def approach_speed(self, pair: tuple[SceneShape, SceneShape], crown: float) -> float:
        """Upper bound of the rate of a gap [m/s]; see :func:`spacerobot.shapes.approach_speed`.

        A shape's point p moves at ``v + omega x (p - c)``. Relative to the first shape's axes, the second
        shape's points are at most ``radius`` from its centre, for any normal.
        """
        frames = [self.frame(shape.frame) for shape in pair]
        centres = [
            f.position + f.rotation @ shape.placement[:3, 3] for f, shape in zip(frames, pair, strict=True)
        ]
        radii = [_radius(shape.config, crown) for shape in pair]

        def speed(of: int, at: Array) -> Array:
            """Velocity [m/s] of body ``of``'s material point at ``at``."""
            return frames[of].velocity[:3] + np.cross(frames[of].velocity[3:], at - frames[of].position)

        omega = [f.velocity[3:] for f in frames]
        turning = np.linalg.norm(omega[1] - omega[0])
        bounds = [
            np.linalg.norm(speed(1, c) - speed(0, c)) + (turning * r if r < np.inf else np.inf)
            for c, r in zip(centres, radii, strict=True)
        ]
        if max(radii) < np.inf:
            rolling = sum(np.linalg.norm(w) * r for w, r in zip(omega, radii, strict=True))
            bounds.append(np.linalg.norm(speed(1, centres[1]) - speed(0, centres[0])) + rolling)
        return float(min(bounds))


@functools.lru_cache(maxsize=1024)
def _radius(config: CollisionShape, crown: float) -> float:
    """Radius [m] about a shape's origin that contains it without its ball; infinite for a half-space."""
    radius = core_radius(Shape(type(config), ca.SX.eye(3), ca.SX.zeros(3), config.measures()), crown)
    return np.inf if radius is None else float(ca.DM(radius))


def coordinates(model: Any) -> list[tuple[slice, slice]]:
    """Slices of each joint's coordinates in q and v."""
    return [
        (slice(joint.idx_q, joint.idx_q + joint.nq), slice(joint.idx_v, joint.idx_v + joint.nv))
        for joint in list(model.joints)[1:]
    ]


def configuration_rate(places: Sequence[tuple[slice, slice]], q: Array, v: Array) -> Array:
    """Time derivative of Pinocchio's coordinates (nq,), joint by joint; q need not be normalised."""
    rate: Array = np.concatenate([_joint_rate(q[coordinates], v[speed]) for coordinates, speed in places])
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
