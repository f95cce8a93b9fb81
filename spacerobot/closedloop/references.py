"""References as expressions of time (Eq. 39-44)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.rotations import rotation_exp, rotation_from_rpy
from spacerobot.scenario import Circle, Line, Reference, Spline
from spacerobot.scenario.reference import Hold

DEGREE = np.pi / 180


@dataclass(frozen=True)
class Motion:
    """Where a frame shall be and how it shall move, world axes.

    Attributes
    ----------
    position, velocity, acceleration
        Of the frame's origin, 3x1 each [m, m/s, m/s^2].
    rotation
        Frame axes to world axes, 3x3.
    angular_velocity, angular_acceleration
        3x1 each [rad/s, rad/s^2].
    """

    position: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    rotation: ca.SX
    angular_velocity: ca.SX
    angular_acceleration: ca.SX


@dataclass(frozen=True)
class _Profile:
    """A scalar or vector function of time with its first two derivatives."""

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX


def build_motion(
    reference: Reference,
    path: str,
    time: ca.SX,
    parameters: Parameters,
    constants: Constants,
    *,
    start: tuple[ca.SX, ca.SX],
    pivot: ca.SX | None = None,
) -> Motion:
    """Motion of a frame that begins at ``start`` and is carried by a reference.

    Parameters
    ----------
    reference, path
        The reference and its dotted path.
    time
        Symbol of time [s].
    start
        Initial rotation (3x3) and origin (3x1) [m] of the frame, expressions of the parameters.
    pivot
        Initial position of the point that the reference's displacement moves (3x1) [m], where that is not
        the frame's own origin: the target's, if the frame is carried along by it.
    """
    moved = _displacement(reference, path, time, parameters, constants)
    turned, angular_velocity, angular_acceleration = _rotation(reference, path, time, parameters, constants)
    rotation0 = constants.hoist(f"{path}.start.rotation", start[0])
    pivot0 = constants.hoist(f"{path}.start.pivot", start[1] if pivot is None else pivot)
    lever0 = ca.SX(3, 1) if pivot is None else constants.hoist(f"{path}.start.lever", start[1] - pivot)
    lever = ca.mtimes(turned, lever0)
    swing = cross(angular_velocity, lever)
    return Motion(
        position=pivot0 + moved.value + lever,
        velocity=moved.rate + swing,
        acceleration=moved.acceleration + cross(angular_acceleration, lever) + cross(angular_velocity, swing),
        rotation=ca.mtimes(turned, rotation0),
        angular_velocity=angular_velocity,
        angular_acceleration=angular_acceleration,
    )


def cubic_blend(time: ca.SX, duration: ca.SX, end: ca.SX) -> _Profile:
    """From 0 to 1 at rest at both ends, held afterwards (Eq. 42); ``end`` is the jump there."""
    moving = time < end
    s = ca.if_else(moving, time / duration, 1)
    return _Profile(
        value=s * s * (3 - 2 * s),
        rate=6 * s * (1 - s) / duration,
        acceleration=ca.if_else(moving, (6 - 12 * s) / duration**2, 0),
    )


def _displacement(
    reference: Reference, path: str, time: ca.SX, parameters: Parameters, constants: Constants
) -> _Profile:
    if isinstance(reference, Hold):
        return _Profile(ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1))
    if isinstance(reference, Spline):
        return _spline(reference, path, time, parameters, constants)
    blend = _blend(path, time, parameters, constants)
    if isinstance(reference, Line):
        along = constants.hoist(f"{path}.displacement", parameters.sparse_vector(f"{path}.displacement"))
        return _Profile(along * blend.value, along * blend.rate, along * blend.acceleration)
    return _circle(reference, path, blend, parameters, constants)


def _blend(path: str, time: ca.SX, parameters: Parameters, constants: Constants) -> _Profile:
    duration = parameters(f"{path}.duration")
    end = constants.jump(path, duration)
    return cubic_blend(time, constants.hoist(f"{path}.duration", duration), end)


def _circle(
    reference: Circle, path: str, blend: _Profile, parameters: Parameters, constants: Constants
) -> _Profile:
    """Displacement along a circle, X_ref - X_ref(0) of Eq. 40, 41, and its derivatives (Eq. 43, 44)."""
    first = constants.hoist(f"{path}.start_angle", parameters.sparse(f"{path}.start_deg") * DEGREE)
    last = constants.hoist(f"{path}.end_angle", parameters(f"{path}.end_deg") * DEGREE)
    radius = constants.hoist(f"{path}.radius", parameters(f"{path}.radius"))
    delta = first + (last - first) * blend.value
    rate, acceleration = (last - first) * blend.rate, (last - first) * blend.acceleration
    cos, sin = ca.cos(delta), ca.sin(delta)
    plane = ca.SX.eye(3)
    if any(reference.plane_deg):
        angles = parameters.vector(f"{path}.plane_deg") * DEGREE
        plane = constants.hoist(f"{path}.plane", rotation_from_rpy(angles))
    across = radius * plane[:, :2]

    def in_plane(x: ca.SX, y: ca.SX) -> ca.SX:
        return ca.mtimes(across, ca.vertcat(x, y))

    return _Profile(
        value=in_plane(cos - ca.cos(first), sin - ca.sin(first)),
        rate=in_plane(-sin * rate, cos * rate),
        acceleration=in_plane(-sin * acceleration - cos * rate**2, cos * acceleration - sin * rate**2),
    )


def _spline(
    reference: Spline, path: str, time: ca.SX, parameters: Parameters, constants: Constants
) -> _Profile:
    """Clamped cubic spline; its coefficients are linear in the waypoints."""
    knots = np.array(reference.times)
    count = len(knots)
    points = ca.vertcat(*(parameters.sparse_vector(f"{path}.displacements.{i}").T for i in range(count)))
    second = constants.hoist(f"{path}.curvature", ca.mtimes(_clamped_spline_operator(knots), points))
    points = constants.hoist(f"{path}.displacements", points)
    value, rate, acceleration = points[count - 1, :].T, ca.SX(3, 1), ca.SX(3, 1)
    for i in reversed(range(count - 1)):
        width = float(knots[i + 1] - knots[i])
        left, right = (knots[i + 1] - time) / width, (time - knots[i]) / width
        a, b = points[i, :].T, points[i + 1, :].T
        m, n = second[i, :].T, second[i + 1, :].T
        here = time < constants.jump(f"{path}.{i + 1}", ca.SX(float(knots[i + 1])))
        inside_value = left * a + right * b + (m * (left**3 - left) + n * (right**3 - right)) * (width**2 / 6)
        inside_rate = (b - a) / width + (n * (3 * right**2 - 1) - m * (3 * left**2 - 1)) * (width / 6)
        value = ca.if_else(here, inside_value, value)
        rate = ca.if_else(here, inside_rate, rate)
        acceleration = ca.if_else(here, left * m + right * n, acceleration)
    return _Profile(value, rate, acceleration)


def _clamped_spline_operator(knots: np.ndarray) -> ca.DM:
    """Matrix (n, n) from waypoints to second derivatives at the knots, slopes zero at both ends."""
    n, h = len(knots), np.diff(knots)
    left, right = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        if i > 0:
            left[i, i - 1], left[i, i] = h[i - 1] / 6, left[i, i] + h[i - 1] / 3
            right[i, i - 1] += 1 / h[i - 1]
            right[i, i] -= 1 / h[i - 1]
        if i < n - 1:
            left[i, i + 1], left[i, i] = h[i] / 6, left[i, i] + h[i] / 3
            right[i, i + 1] += 1 / h[i]
            right[i, i] -= 1 / h[i]
    return ca.DM(np.linalg.solve(left, right))


def _rotation(
    reference: Reference, path: str, time: ca.SX, parameters: Parameters, constants: Constants
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Rotation since the start (3x3), angular velocity and acceleration (3x1), about a fixed axis."""
    if isinstance(reference, Hold | Spline):
        return ca.SX.eye(3), ca.SX(3, 1), ca.SX(3, 1)
    full = constants.hoist(f"{path}.rotation_deg", parameters.sparse_vector(f"{path}.rotation_deg") * DEGREE)
    if full.nnz() == 0:
        return ca.SX.eye(3), ca.SX(3, 1), ca.SX(3, 1)
    blend = _blend(path, time, parameters, constants)
    return rotation_exp(full * blend.value), full * blend.rate, full * blend.acceleration
