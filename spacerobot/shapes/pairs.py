"""Which pairs of shapes there are, and how near they are to each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from spacerobot.shapes import boxes, cylinders, points, segments
from spacerobot.shapes.points import Nearest
from spacerobot.shapes.shape import Shape

ShapeKind = Literal["sphere", "capsule", "cylinder", "box", "plane"]


@dataclass(frozen=True)
class Proximity:
    """How near two shapes are.

    Attributes
    ----------
    gap
        Signed distance (1x1) [m], negative where they overlap.
    normal
        Unit vector (3x1) from the first to the second.
    point
        Halfway between the two points that are nearest to each other, or deepest in each other (3x1) [m].
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX


def _by_centre(nearest: Callable[[ca.SX, Shape], Nearest]) -> Callable[[Shape, Shape], Nearest]:
    return lambda sphere, other: nearest(sphere.position, other)


def _of_sphere(point: ca.SX, sphere: Shape) -> Nearest:
    return points.to_point(point, sphere.position)


PAIRS: dict[tuple[ShapeKind, ShapeKind], Callable[[Shape, Shape], Nearest]] = {
    ("sphere", "sphere"): _by_centre(_of_sphere),
    ("sphere", "capsule"): _by_centre(points.to_segment),
    ("sphere", "plane"): _by_centre(points.to_plane),
    ("sphere", "box"): _by_centre(points.to_box),
    ("sphere", "cylinder"): _by_centre(points.to_cylinder),
    ("capsule", "capsule"): segments.to_segment,
    ("capsule", "plane"): segments.to_plane,
    ("capsule", "box"): segments.to_box,
    ("capsule", "cylinder"): segments.to_cylinder,
    ("box", "plane"): boxes.to_plane,
    ("box", "box"): boxes.to_box,
    ("cylinder", "plane"): cylinders.to_plane,
}
"""From the first shape's core to the second's; both orders are allowed."""
ROUND = ("sphere", "capsule")
"""Shapes that are a core with a radius around it."""


def proximity(kinds: tuple[ShapeKind, ShapeKind], one: Shape, other: Shape) -> Proximity:
    """How near two shapes are.

    Parameters
    ----------
    kinds
        Theirs, a pair of :data:`PAIRS` in either order.
    one, other
        The shapes.

    Raises
    ------
    KeyError
        If there is no such pair.
    """
    if kinds not in PAIRS:
        found = proximity((kinds[1], kinds[0]), other, one)
        return Proximity(found.gap, -found.normal, found.point)
    distance, away, nearest = PAIRS[kinds](one, other)
    own, radius = (
        shape.radius if kind in ROUND else 0 for kind, shape in zip(kinds, (one, other), strict=True)
    )
    gap = distance - own - radius
    # the surface points are those of the cores, moved by the radii towards each other
    return Proximity(gap, -away, nearest + away * (radius + gap / 2))
