"""Signed distance from a capsule's segment to a convex core: a segment, a half-space, a box, a cylinder."""

from __future__ import annotations

import casadi as ca

from spacerobot.dynamics.algebra import cross
from spacerobot.shapes import points
from spacerobot.shapes.points import Nearest, clamp
from spacerobot.shapes.shape import Shape

_PARALLEL = 1e-12
"""Square of the sine of an angle below which two lines are treated as parallel."""
_HALVINGS, _LEVEL, _TURNED = 26, 1e-9, 1e-6
"""How often a segment is halved; slope that counts as none; longest last step [m]."""
_BEYOND = 1.01
"""How far beyond its ends a segment is looked at, so that an end is met exactly."""
APART = 1e9
"""[m] More than any depth."""


def to_segment(segment: Shape, other: Shape) -> Nearest:
    """From a segment to a segment."""
    between, cosine = segment.position - other.position, ca.dot(segment.axis, other.axis)
    own, across = ca.dot(segment.axis, between), ca.dot(other.axis, between)
    square = ca.fmax(1 - cosine**2, _PARALLEL)
    on_own = clamp((cosine * across - own) / square, segment.half)
    on_other = clamp(cosine * on_own + across, other.half)
    on_own = clamp(cosine * on_other - own, segment.half)
    nearest = other.position + on_other * other.axis
    return points.to_point(segment.position + on_own * segment.axis, nearest)


def to_plane(segment: Shape, plane: Shape) -> Nearest:
    """From a segment to a half-space: from its lower end, or its middle where it is parallel."""
    lower = ca.sign(ca.dot(plane.axis, segment.axis)) * segment.half
    return points.to_plane(segment.position - lower * segment.axis, plane)


def to_box(segment: Shape, box: Shape) -> Nearest:
    """From a segment to a box; where the segment itself is inside, the way out is the shortest one."""
    middle, axis = box.inside(segment.position), ca.mtimes(box.rotation.T, segment.axis)
    along = nearest_to_box(middle, axis, segment.half, box.half)
    apart = points.to_box(segment.position + along * segment.axis, box)
    depth, direction, deepest = _way_out(middle, axis, segment.half, box.half)
    nearest = box.position + box.outside(deepest - depth * direction)
    inside = depth < 0
    return (
        ca.if_else(inside, depth, apart[0]),
        ca.if_else(inside, box.outside(direction), apart[1]),
        ca.if_else(inside, nearest, apart[2]),
    )


def to_cylinder(segment: Shape, cylinder: Shape) -> Nearest:
    """From a segment to a cylinder; where the segment itself is inside, that of its deepest point."""
    middle, axis = cylinder.inside(segment.position), ca.mtimes(cylinder.rotation.T, segment.axis)
    along = _nearest_to_cylinder(middle, axis, segment.half, cylinder)
    return points.to_cylinder(segment.position + along * segment.axis, cylinder)


def _nearest_to_cylinder(middle: ca.SX, axis: ca.SX, half: ca.SX, cylinder: Shape) -> ca.SX:
    """Place on a segment (1x1) [m] that is nearest to a cylinder, or deepest in it, in the cylinder's axes.

    The signed distance is convex along the segment. Its slope is bisected from both sides, so that of a whole
    stretch that is equally near the middle is taken; a step by Newton's method then makes it exact, and with
    it the derivatives.
    """
    upright = Shape(ca.SX.eye(3), ca.SX(3, 1), cylinder.radius, cylinder.half)

    def slope_at(place: ca.SX) -> ca.SX:
        return ca.dot(axis, points.to_cylinder(middle + place * axis, upright)[1])

    ends = []
    for side in (-1, 1):
        low, high = -_BEYOND * half, _BEYOND * half
        for _ in range(_HALVINGS):
            between = (low + high) / 2
            rises = slope_at(between) > -side * _LEVEL
            low, high = ca.if_else(rises, low, between), ca.if_else(rises, between, high)
        ends.append(clamp((low + high) / 2, half))
    found = (ends[0] + ends[1]) / 2
    place = ca.SX.sym("place")
    slope = slope_at(place)
    value, bend = ca.substitute([slope, ca.jacobian(slope, place)], [place], [found])
    unique = ca.logic_and(bend > _LEVEL, ca.fabs(value) < _TURNED * bend)
    return clamp(found - ca.if_else(unique, value / ca.fmax(bend, _LEVEL), 0), half)


def nearest_to_box(middle: ca.SX, axis: ca.SX, half: ca.SX, size: ca.SX) -> ca.SX:
    """Place on a segment (1x1) [m] that is nearest to a box, in the box's axes.

    Half the squared distance is convex along the segment; its slope is piecewise linear with kinks where the
    line crosses the planes of the box's faces. So the slope's zero lies between two neighbouring ones of
    these places and the ends, and is found exactly.
    """
    places = [-half, half]
    for i in range(3):
        slope = ca.if_else(axis[i] < 0, ca.fmin(axis[i], -_PARALLEL), ca.fmax(axis[i], _PARALLEL))
        places += [clamp((side * size[i] - middle[i]) / slope, half) for side in (-1, 1)]

    def slope_at(place: ca.SX) -> ca.SX:
        point = middle + place * axis
        return ca.dot(axis, point - clamp(point, size))

    below, above = -half, half
    for place in places:
        slope = slope_at(place)
        below = ca.if_else(slope <= 0, ca.fmax(below, place), below)
        above = ca.if_else(slope >= 0, ca.fmin(above, place), above)
    fall, rise = slope_at(below), slope_at(above)
    steep = rise - fall
    between = below - fall * (above - below) / ca.if_else(steep > 0, steep, 1)
    # where the slope is zero on a whole stretch, its ends have changed places: its middle
    return ca.if_else(ca.logic_and(steep > 0, below < above), between, (below + above) / 2)


def _way_out(middle: ca.SX, axis: ca.SX, half: ca.SX, size: ca.SX) -> Nearest:
    """Signed distance of a segment from a box by the faces of their Minkowski sum, and the segment's point.

    It is the distance where it is negative; else a lower bound. Axes of the box.
    """
    depth, direction, deepest = ca.SX(-APART), ca.SX(3, 1), middle
    for i in range(3):
        unit = ca.SX.eye(3)[:, i]
        for edge in (False, True):
            normal = cross(unit, axis) if edge else unit
            length = ca.sqrt(ca.dot(normal, normal) + points.TINY)
            normal = ca.if_else(ca.dot(normal, middle) < 0, -1, 1) * normal / length
            reach = ca.dot(ca.fabs(normal), size) + half * ca.fabs(ca.dot(normal, axis))
            found = ca.dot(normal, middle) - reach
            if edge:
                found = ca.if_else(length > _PARALLEL**0.5, found, -APART)
                corner = ca.sign(normal) * size + found * normal - middle
                across = axis - axis[i] * unit
                place = ca.dot(across, corner) / ca.fmax(ca.dot(across, across), _PARALLEL)
            else:
                place = -half * ca.sign(ca.dot(normal, axis))
            better = found > depth
            depth = ca.if_else(better, found, depth)
            direction = ca.if_else(better, normal, direction)
            deepest = ca.if_else(better, middle + clamp(place, half) * axis, deepest)
    return depth, direction, deepest
