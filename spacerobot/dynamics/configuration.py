"""Configuration manifold: rates of Pinocchio's coordinates, and normalisation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.joints import JointKind, JointModel, read_joints
from spacerobot.dynamics.rotations import rotation_from_quaternion

if TYPE_CHECKING:
    import pinocchio


def configuration_derivative(model: pinocchio.Model, q: ca.SX, v: ca.SX) -> ca.SX:
    """Time derivative of the configuration for a velocity in Pinocchio's coordinates.

    Args:
        model: Any model of supported joints.
        q: Configuration, nq.
        v: Velocity, nv.

    Returns:
        casadi.SX: ``qdot``, nq, tangent to the manifold at ``q``.
    """
    return ca.vertcat(*(_rate(joint, joint.coordinates(q), joint.rates(v)) for joint in read_joints(model)))


def normalise(model: pinocchio.Model, q: ca.SX) -> ca.SX:
    """Normalised configuration: (cos, sin) pairs and quaternions are scaled to length one.

    Args:
        model: Any model of supported joints.
        q: Configuration, Pinocchio's coordinates, nq.

    Returns:
        casadi.SX: Configuration, nq.
    """
    return ca.vertcat(*(_normalised(joint, joint.coordinates(q)) for joint in read_joints(model)))


def _rate(joint: JointModel, q: ca.SX, v: ca.SX) -> ca.SX:
    match joint.kind:
        case JointKind.UNBOUNDED:
            return ca.vertcat(-q[1] * v, q[0] * v)
        case JointKind.PLANAR:
            cosine, sine = q[2], q[3]
            return ca.vertcat(
                cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], -sine * v[2], cosine * v[2]
            )
        case JointKind.FREE_FLYER:
            # half the product of the quaternion with the angular velocity in the moving axes
            x, y, z, w = ca.vertsplit(q[3:7])
            half = 0.5 * v[3:6]
            a, b, c = ca.vertsplit(half)
            quaternion_rate = ca.vertcat(
                w * a + y * c - z * b,
                w * b + z * a - x * c,
                w * c + x * b - y * a,
                -(x * a + y * b + z * c),
            )
            return ca.vertcat(ca.mtimes(rotation_from_quaternion(q[3:7]), v[:3]), quaternion_rate)
        case _:
            return v


def _normalised(joint: JointModel, q: ca.SX) -> ca.SX:
    match joint.kind:
        case JointKind.UNBOUNDED:
            return q / ca.norm_2(q)
        case JointKind.PLANAR:
            return ca.vertcat(q[:2], q[2:4] / ca.norm_2(q[2:4]))
        case JointKind.FREE_FLYER:
            return ca.vertcat(q[:3], q[3:7] / ca.norm_2(q[3:7]))
        case _:
            return q
