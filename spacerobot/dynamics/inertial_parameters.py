"""Ten inertial parameters of a rigid body, in which its momentum and its wrench are linear.

They are m, m c and the six of the inertia I about the origin of the axes, in Pinocchio's order: m, m c_x,
m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (Wensing, Niemeyer and Slotine, Int. J. Robotics Research
43(1), 2024).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.dynamics.algebra import cross, skew

SIZE = 10
PLANAR = (0, 1, 2, 9)
"""Indices of the parameters on which a motion in the x-y plane depends."""
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Row and column of the inertia's six entries, in the order of the parameters."""
INTERIOR = 1e-12
"""Minimum distance from the boundary of realisable bodies, relative to the second moments about the
origin."""
_NAMED = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Row and column of the inertia's six entries, in the order of scenarios."""


def _matrix(entries: ca.SX, places: tuple[tuple[int, int], ...]) -> ca.SX:
    matrix = ca.SX(3, 3)
    for (i, j), entry in zip(places, ca.vertsplit(entries), strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def _entries(matrix: ca.SX, places: tuple[tuple[int, int], ...]) -> ca.SX:
    return ca.vertcat(*(matrix[place] for place in places))


def _steiner(mass: ca.SX, centre: ca.SX) -> ca.SX:
    """Inertia (3x3) of a point mass at ``centre`` about the origin."""
    return mass * (ca.dot(centre, centre) * ca.SX.eye(3) - ca.mtimes(centre, centre.T))


def is_realisable(parameters: Array) -> bool:
    """Whether a body can have these parameters (10,), or, in a plane, those of :data:`PLANAR` (4,).

    A body is realisable if its mass and its second moments about the centre of mass are positive, that is, if
    its pseudo-inertia is positive definite (Rucker and Wensing, IEEE RA-L 7(2), 2022). In a plane, mass and
    moment of inertia about the centre of mass are positive.
    """
    return bool(parameters[0] > 0 and _central_spread(parameters)[0] > 0)


def move_inside(parameters: Array) -> Array:
    """Parameters moved off the boundary of realisable bodies by more than rounding; others unchanged.

    The body nearest to unrealisable parameters has no extent along some axis, and rounding may place its
    parameters on either side of the boundary. Therefore 1e-12 of the second moments about the origin are
    added along each axis: a thousand times the rounding errors of m c c^T, which is subtracted to move to the
    centre of mass.

    Args:
        parameters: Parameters with positive mass, (10,) or (4,).
    """
    smallest, about_origin = _central_spread(parameters)
    added = max(0.0, INTERIOR * about_origin - smallest)
    inside = np.array(parameters, dtype=float)
    if parameters.size == len(PLANAR):
        inside[3] += added
    else:
        inside[[4, 6, 9]] += 2 * added  # I = tr(S) 1 - S, so that S + s 1 has the inertia I + 2 s 1
    return inside


def _central_spread(parameters: Array) -> tuple[float, float]:
    """Smallest second moment of mass about the centre of mass, and sum of second moments about the origin.

    In a plane, both refer to the moment of inertia about the plane's normal.
    """
    mass, moment = parameters[0], parameters[1:-1] if parameters.size == len(PLANAR) else parameters[1:4]
    if parameters.size == len(PLANAR):
        return float(parameters[3] - moment @ moment / mass), float(parameters[3])
    matrix = pin.PseudoInertia.FromDynamicParameters(parameters).toMatrix()
    about_origin = matrix[:3, :3]
    central = about_origin - np.outer(moment, moment) / mass
    return float(np.linalg.eigvalsh(central)[0]), float(np.trace(about_origin))


def inertial_parameters(mass: ca.SX, centre: ca.SX, inertia: ca.SX) -> ca.SX:
    """Ten parameters (10x1) of a body from mass, centre of mass and inertia about it.

    Args:
        mass: Mass (1x1) [kg].
        centre: Centre of mass (3x1) [m].
        inertia: ixx, iyy, izz, ixy, ixz, iyz about the centre of mass (6x1) [kg m^2].
    """
    about = _matrix(inertia, _NAMED) + _steiner(mass, centre)
    return ca.vertcat(mass, mass * centre, _entries(about, _PLACES))


def parameters_about_origin(mass: ca.SX, moment: ca.SX, inertia: ca.SX) -> ca.SX:
    """Ten parameters (10x1) of a body from its moments about the origin.

    Args:
        mass: Mass (1x1) [kg].
        moment: Product of mass and centre of mass (3x1) [kg m].
        inertia: Inertia about the origin (3x3) [kg m^2].
    """
    return ca.vertcat(mass, moment, _entries(inertia, _PLACES))


def mass_properties(parameters: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mass, centre of mass and inertia from the ten parameters; inverse of :func:`inertial_parameters`."""
    mass, centre = parameters[0], parameters[1:4] / parameters[0]
    central = _matrix(parameters[4:], _PLACES) - _steiner(mass, centre)
    return mass, centre, _entries(central, _NAMED)


def spatial_inertia(parameters: ca.SX) -> ca.SX:
    """Spatial inertia (6x6): maps a twist, linear velocity first, to momentum about the origin."""
    mass, moment = parameters[0] * ca.SX.eye(3), skew(parameters[1:4])
    rotational = _matrix(parameters[4:], _PLACES)
    return ca.vertcat(ca.horzcat(mass, -moment), ca.horzcat(moment, rotational))


def momentum_regressor(velocity: ca.SX, spin: ca.SX) -> ca.SX:
    """Linear momentum, and angular momentum about the origin, per parameter (6x10); axes of the body.

    Args:
        velocity, spin: Velocity of the origin [m/s] and angular velocity [rad/s] (3x1 each).
    """
    one = ca.SX.eye(SIZE)
    twist = ca.vertcat(velocity, spin)
    return ca.horzcat(*(ca.mtimes(spatial_inertia(one[:, i]), twist) for i in range(SIZE)))


def inertial_wrench(
    parameters: ca.SX, acceleration: ca.SX, spin: ca.SX, spin_acceleration: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Force and torque about the origin (3x1 each) that cause a motion; axes of the body.

    ``f = m a + alpha x m c + w x (w x m c)``, ``n = I alpha + w x I w + m c x a``.

    Args:
        parameters: Parameters of the body (10x1).
        acceleration: Acceleration of the origin, gravity subtracted (3x1) [m/s^2].
        spin, spin_acceleration: Angular velocity and acceleration of the body (3x1 each) [rad/s, rad/s^2].
    """
    mass, moment, about = parameters[0], parameters[1:4], _matrix(parameters[4:], _PLACES)
    force = mass * acceleration + cross(spin_acceleration, moment) + cross(spin, cross(spin, moment))
    turning = ca.mtimes(about, spin_acceleration) + cross(spin, ca.mtimes(about, spin))
    return force, turning + cross(moment, acceleration)


def in_other_axes(parameters: ca.SX, rotation: ca.SX, origin: ca.SX) -> ca.SX:
    """Parameters (10x1) of the same body in other axes.

    Args:
        parameters: Parameters in the old axes (10x1).
        rotation, origin: Old axes to new ones (3x3), and the old origin in the new axes (3x1) [m].
    """
    mass, centre, inertia = mass_properties(parameters)
    turned = ca.mtimes(rotation, ca.mtimes(_matrix(inertia, _NAMED), rotation.T))
    return inertial_parameters(mass, origin + ca.mtimes(rotation, centre), _entries(turned, _NAMED))
