"""Signed distance from a point to a convex core: point, segment, half-space, box or cylinder.

Each function returns the distance, the unit vector from the core to the point, and the core's nearest point.
Inside a solid core, the distance is negative and the unit vector is the normal of the nearest face.
"""

from __future__ import annotations

import casadi as ca

from spacerobot.shapes.clamp import TINY, clamp
from spacerobot.shapes.shape import Nearest, Shape


def to_point(point: ca.SX, other: ca.SX) -> Nearest:
    """Distance from a point to a point (3x1 each)."""
    gap = point - other
    distance = ca.sqrt(ca.dot(gap, gap) + TINY)
    return distance, gap / distance, other


def to_segment(point: ca.SX, segment: Shape, half: ca.SX) -> Nearest:
    """Distance from a point (3x1) to a segment along the shape's z axis, with half length (1x1) [m]."""
    along = clamp(ca.dot(segment.axis, point - segment.position), half)
    return to_point(point, segment.position + along * segment.axis)


def to_plane(point: ca.SX, plane: Shape) -> Nearest:
    """Distance from a point (3x1) to a half-space."""
    distance = ca.dot(plane.axis, point - plane.position)
    return distance, plane.axis, point - distance * plane.axis


def to_box(point: ca.SX, box: Shape, half: ca.SX) -> Nearest:
    """Distance from a point (3x1) to a box with half edges ``half`` (3x1) [m]."""
    local = box.inside(point)
    distance, direction, nearest = _to_block(local, half)
    return distance, box.outside(direction), box.position + box.outside(nearest)


def to_cylinder(point: ca.SX, cylinder: Shape, radius: ca.SX, half: ca.SX) -> Nearest:
    """Distance from a point (3x1) to a cylinder along the shape's z axis, of a radius and half length [m].

    In the plane of the point and the axis, the cylinder is a rectangle.
    """
    local = cylinder.inside(point)
    out = ca.sqrt(local[0] ** 2 + local[1] ** 2 + TINY)
    size = ca.vertcat(radius, half)
    distance, direction, nearest = _to_block(ca.vertcat(out, local[2]), size)

    def lifted(flat: ca.SX) -> ca.SX:
        return cylinder.outside(ca.vertcat(local[:2] / out * flat[0], flat[1]))

    return distance, lifted(direction), cylinder.position + lifted(nearest)


def _to_block(point: ca.SX, half: ca.SX) -> Nearest:
    """Distance from a point (n x 1) to the box between -half and half in n dimensions."""
    nearest = clamp(point, half)
    gap = point - nearest
    away = ca.sqrt(ca.dot(gap, gap) + TINY)
    over = ca.fabs(point) - half
    deepest = ca.mmax(over)
    is_out = deepest > 0
    face, chosen = [], ca.SX(0)
    for i in range(point.size1()):  # the first of equally near faces
        here = ca.logic_and(over[i] >= deepest, chosen < 0.5)
        face.append(ca.if_else(here, ca.if_else(point[i] < 0, -1, 1), 0))
        chosen = chosen + here
    direction = ca.if_else(is_out, gap / away, ca.vertcat(*face))
    distance = ca.if_else(is_out, away, deepest)
    return distance, direction, point - distance * direction
