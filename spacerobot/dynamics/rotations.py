"""Rotations as CasADi expressions: exponential, logarithm, quaternions and roll-pitch-yaw.

All maps have the right value *and* the right derivatives at the identity. If a closed form divides by an
angle, a short series replaces it near zero, and the divisor is replaced by a number away from zero there.
"""

from __future__ import annotations

import casadi as ca

from spacerobot.dynamics.algebra import IDENTITY3, cross, skew
from spacerobot.dynamics.recorded import recorded

_NEAR_ZERO = 1e-3
"""Square of the angle (or of its tangent) below which series are used; six terms leave an error under
1e-18."""

_Z = ca.SX.eye(3)[:, 2]
_Y = ca.SX.eye(3)[:, 1]
_X = ca.SX.eye(3)[:, 0]


def turn(axis: ca.SX, cosine: ca.SX, sine: ca.SX) -> ca.SX:
    """Rotation about a unit axis by an angle given as (cos, sin), 3x3 (Rodrigues).

    About a coordinate axis, of either sign, the result keeps its four structural zeros and the one.

    Args:
        axis: Unit vector, 3x1.
        cosine, sine: Cosine and sine of the angle, 1x1 each.
    """
    return _turn(axis, cosine, sine, coordinate=axis.nnz() == 1 and axis.is_constant())


@recorded((3, 1), (1, 1), (1, 1))
def _turn(axis: ca.SX, cosine: ca.SX, sine: ca.SX, *, coordinate: bool) -> ca.SX:
    if coordinate:
        along = ca.diag(axis * axis)  # 1 on the axis, whatever its sign
        return along + cosine * (IDENTITY3 - along) + sine * skew(axis)
    return (1 - cosine) * ca.mtimes(axis, axis.T) + cosine * IDENTITY3 + sine * skew(axis)


def rotation_from_rpy(rpy: ca.SX) -> ca.SX:
    """Rotation of roll, pitch and yaw about fixed axes, ``Rz(yaw) Ry(pitch) Rx(roll)`` as in URDF, 3x3.

    Args:
        rpy: Roll, pitch, yaw, rad, 3x1. Structurally zero angles add no operations.
    """
    result = IDENTITY3
    for axis, angle in ((_Z, rpy[2]), (_Y, rpy[1]), (_X, rpy[0])):
        if angle.nnz():
            result = ca.mtimes(result, turn(axis, ca.cos(angle), ca.sin(angle)))
    return result


def rotation_exp(vector: ca.SX) -> ca.SX:
    """Rotation of a rotation vector, smooth everywhere.

    Args:
        vector: Axis times angle, rad, 3x1.

    Returns:
        casadi.SX: 3x3; about a coordinate axis if only one entry of ``vector`` is structurally non-zero.
    """
    if vector.nnz() == 1:
        axis = ca.SX(vector.sparsity(), 1)
        angle = ca.sum1(vector)
        return turn(axis, ca.cos(angle), ca.sin(angle))
    return _rotation_exp(vector)


@recorded((3, 1))
def _rotation_exp(vector: ca.SX) -> ca.SX:
    square = ca.dot(vector, vector)
    near = square < _NEAR_ZERO
    angle = ca.sqrt(ca.if_else(near, 1, square))
    first = ca.if_else(near, _series(square, (1, -6, 120, -5040, 362880, -39916800)), ca.sin(angle) / angle)
    half = ca.sin(0.5 * angle)
    second = ca.if_else(
        near,
        _series(square, (2, -24, 720, -40320, 3628800, -479001600)),
        2 * half * half / (angle * angle),
    )
    matrix = skew(vector)
    return IDENTITY3 + first * matrix + second * ca.mtimes(matrix, matrix)


def rotation_log(rotation: ca.SX) -> ca.SX:
    """Rotation vector of a rotation, of length 0 to pi, smooth below pi.

    Args:
        rotation: 3x3. If its structural zeros show a rotation about a coordinate axis, one ``atan2``
            suffices.

    Returns:
        casadi.SX: Axis times angle, rad, 3x1.
    """
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        if not any(rotation.has_nz(a, b) for a, b in ((i, k), (k, i), (j, k), (k, j))):
            result = ca.SX(3, 1)
            result[k] = ca.atan2(rotation[j, i] - rotation[i, j], rotation[i, i] + rotation[j, j])
            return result
    return _rotation_log(rotation)


@recorded((3, 3))
def _rotation_log(rotation: ca.SX) -> ca.SX:
    quaternion = _scaled_quaternion(rotation)
    vector, scalar = quaternion[:3], quaternion[3]
    square = ca.dot(vector, vector)
    near = square < _NEAR_ZERO * scalar * scalar
    denominator = ca.if_else(near, scalar, 1)
    length = ca.sqrt(ca.if_else(near, 1, square))
    tangent = square / (denominator * denominator)
    factor = ca.if_else(
        near,
        _series(tangent, (1, -3, 5, -7, 9, -11)) / denominator,
        ca.atan2(length, scalar) / length,
    )
    return 2 * factor * vector


def left_jacobian(phi: ca.SX, vector: ca.SX) -> ca.SX:
    """Product of the left Jacobian of SO(3) at a rotation vector [rad] with a vector (3x1 each)."""
    squared = ca.dot(phi, phi)
    small = squared < 1e-4
    safe = ca.if_else(small, 1.0, squared)
    angle = ca.sqrt(safe)
    first = ca.if_else(small, 1 / 2 - squared / 24 + squared**2 / 720, (1 - ca.cos(angle)) / safe)
    second = ca.if_else(
        small, 1 / 6 - squared / 120 + squared**2 / 5040, (angle - ca.sin(angle)) / (safe * angle)
    )
    across = cross(phi, vector)
    return vector + first * across + second * cross(phi, across)


def inverse_left_jacobian(phi: ca.SX, vector: ca.SX) -> ca.SX:
    """Product of the inverse left Jacobian of SO(3) at a rotation vector [rad] with a vector (3x1 each)."""
    squared = ca.dot(phi, phi)
    small = squared < 1e-4
    safe = ca.if_else(small, 1.0, squared)
    half = ca.sqrt(safe) / 2
    series = 1 / 12 + squared / 720 + squared**2 / 30240
    factor = ca.if_else(small, series, (1 - half * ca.cos(half) / ca.sin(half)) / safe)
    phi_cross = cross(phi, vector)
    return vector - phi_cross / 2 + factor * cross(phi, phi_cross)


@recorded((4, 1))
def rotation_from_quaternion(quaternion: ca.SX) -> ca.SX:
    """Rotation of a unit quaternion ``(x, y, z, w)``, by Pinocchio's own formula, 3x3."""
    x, y, z, w = ca.vertsplit(quaternion)
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return ca.vertcat(
        ca.horzcat(1 - (yy + zz), xy - wz, xz + wy),
        ca.horzcat(xy + wz, 1 - (xx + zz), yz - wx),
        ca.horzcat(xz - wy, yz + wx, 1 - (xx + yy)),
    )


def quaternion_from_rotation(rotation: ca.SX) -> ca.SX:
    """Unit quaternion ``(x, y, z, w)`` of a rotation, ``w >= 0``, 4x1, well conditioned for every angle."""
    quaternion = _scaled_quaternion(rotation)
    return quaternion / ca.norm_2(quaternion)


@recorded((3, 3))
def _scaled_quaternion(rotation: ca.SX) -> ca.SX:
    """Quaternion times four times its largest entry, ``w >= 0``: linear in the rotation's entries."""
    R = rotation
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    x, y, z = R[0, 0], R[1, 1], R[2, 2]
    trace = x + y + z
    by_x = ca.vertcat(1 + x - y - z, xy, xz, a)
    by_y = ca.vertcat(xy, 1 - x + y - z, yz, b)
    by_z = ca.vertcat(xz, yz, 1 - x - y + z, c)
    by_w = ca.vertcat(a, b, c, 1 + trace)
    largest = ca.fmax(ca.fmax(x, y), z)
    best = ca.if_else(x >= largest, by_x, ca.if_else(y >= largest, by_y, by_z))
    best = ca.if_else(trace > 0, by_w, best)
    return ca.if_else(best[3] < 0, -best, best)


def _series(variable: ca.SX, denominators: tuple[int, ...]) -> ca.SX:
    """``sum_k variable^k / denominators[k]`` by Horner's rule."""
    result = ca.SX(0)
    for denominator in reversed(denominators):
        result = result * variable + 1 / denominator
    return result
