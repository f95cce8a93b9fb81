"""Signed distance from a box to a convex core: a half-space, a box."""

from __future__ import annotations

import itertools

import casadi as ca

from spacerobot.dynamics.algebra import cross
from spacerobot.shapes import points
from spacerobot.shapes.points import Nearest, clamp
from spacerobot.shapes.segments import APART, nearest_to_box
from spacerobot.shapes.shape import Shape

_FLAT = 1e-9
"""Sine of an angle below which an edge or a face is treated as parallel to a face."""
_CROSSED = 1e-6
"""Sine of an angle below which two edges are treated as parallel."""
_BETTER = 1e-12
"""[m] By how much a direction must be the shorter way out to be taken instead of an earlier one."""


def to_plane(box: Shape, plane: Shape) -> Nearest:
    """From a box to a half-space: from its lowest corner, or the middle of its lowest edge or face."""
    down = -ca.mtimes(box.rotation.T, plane.axis)
    return points.to_plane(box.position + box.outside(_support(down, box.half, ca.SX.zeros(3))), plane)


def to_box(box: Shape, other: Shape) -> Nearest:
    """From a box to a box; where they overlap, the way out is the shortest one."""
    turn, middle = ca.mtimes(other.rotation.T, box.rotation), other.inside(box.position)
    own = Shape(turn, middle, box.radius, box.half)  # in the other's axes
    depth, direction, deepest = _way_out(own, other.half)
    point, nearest = _nearest_points(own, other.half)
    apart = points.to_point(point, nearest)
    inside = depth < 0
    return (
        ca.if_else(inside, depth, apart[0]),
        other.outside(ca.if_else(inside, direction, apart[1])),
        other.position + other.outside(ca.if_else(inside, deepest - depth * direction, nearest)),
    )


def _nearest_points(box: Shape, size: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Points (3x1 each) [m] of two separate boxes that are nearest to each other, in the second's axes.

    One of them is on an edge of the first box, or is a corner of the second.
    """
    pairs = []
    for i in range(3):
        axis, others = box.rotation[:, i], [k for k in range(3) if k != i]
        for sides in itertools.product((-1, 1), repeat=2):
            centre = box.position
            for k, side in zip(others, sides, strict=True):
                centre = centre + side * box.half[k] * box.rotation[:, k]
            point = centre + nearest_to_box(centre, axis, box.half[i], size) * axis
            pairs.append((point, clamp(point, size)))
    for signs in itertools.product((-1, 1), repeat=3):
        corner = ca.DM(signs) * size
        pairs.append((box.position + box.outside(clamp(box.inside(corner), box.half)), corner))
    point, nearest = pairs[0]
    square = ca.sumsqr(point - nearest)
    for one, other in pairs[1:]:
        found = ca.sumsqr(one - other)
        nearer = found < square
        point, nearest = ca.if_else(nearer, one, point), ca.if_else(nearer, other, nearest)
        square = ca.fmin(found, square)
    return point, nearest


def _way_out(box: Shape, size: ca.SX) -> Nearest:
    """Signed distance of a box from a box by the faces of their Minkowski sum, and the first's deepest point.

    It is the distance where it is negative; else a lower bound. Axes of the second.
    """
    none, units, axes = ca.SX.zeros(3), ca.horzsplit(ca.SX.eye(3)), ca.horzsplit(box.rotation)
    # directions of the normal and of the edges of both that meet; which kind of meeting it is
    tried = [(unit, none, none, 0) for unit in units] + [(axis, none, none, 1) for axis in axes]
    tried += [(cross(unit, axis), axis, unit, 2) for unit in units for axis in axes]
    depth, direction, edge, facing, kind = ca.SX(-APART), none, none, none, ca.SX(0)
    for normal, axis, unit, this in tried:
        length = ca.sqrt(ca.dot(normal, normal) + points.TINY)
        normal = ca.if_else(ca.dot(normal, box.position) < 0, -1, 1) * normal / length
        reach = ca.dot(ca.fabs(normal), size) + ca.dot(ca.fabs(ca.mtimes(box.rotation.T, normal)), box.half)
        found = ca.dot(normal, box.position) - reach
        better = ca.logic_and(found > depth + _BETTER, length > _CROSSED)
        depth, kind = ca.if_else(better, found, depth), ca.if_else(better, this, kind)
        direction = ca.if_else(better, normal, direction)
        edge, facing = ca.if_else(better, axis, edge), ca.if_else(better, unit, facing)
    of_box, of_other = _supports(box, size, direction)
    across = cross(direction, facing)
    lean = ca.dot(edge, across)
    place = ca.dot(of_other - of_box, across) / ca.if_else(kind > 1, lean, 1)
    in_face, crossing = of_other + depth * direction, of_box + place * edge
    return depth, direction, ca.if_else(kind > 1, crossing, ca.if_else(kind > 0, in_face, of_box))


def _supports(box: Shape, size: ca.SX, direction: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Point of a box that is farthest against a direction, and of the other one along it (3x1 each) [m].

    Where that is a whole edge or face, the middle of the stretch along which the other box extends.
    """
    turned = box.inside(ca.SX.zeros(3))  # the other's centre in the axes of the box
    across, back = ca.fabs(box.rotation), ca.fabs(box.rotation.T)
    of_box = _support(
        -ca.mtimes(box.rotation.T, direction), box.half, _shared(box.half, turned, ca.mtimes(back, size))
    )
    of_other = _support(direction, size, _shared(size, box.position, ca.mtimes(across, box.half)))
    return box.position + box.outside(of_box), of_other


def _shared(half: ca.SX, centre: ca.SX, reach: ca.SX) -> ca.SX:
    """Middle of what -half to half and centre - reach to centre + reach have in common, axis by axis."""
    return (clamp(centre - reach, half) + clamp(centre + reach, half)) / 2


def _support(direction: ca.SX, half: ca.SX, flat: ca.SX) -> ca.SX:
    """Point of a box farthest along a direction, own axes; along edges across it that of ``flat``."""
    return ca.if_else(ca.fabs(direction) > _FLAT, ca.sign(direction) * half, flat)
