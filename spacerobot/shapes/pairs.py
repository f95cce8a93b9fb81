"""Which pairs of shapes there are, and how near they are to each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from spacerobot.shapes import crowned, points
from spacerobot.shapes.points import Nearest
from spacerobot.shapes.shape import Shape, ShapeKind


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
    lead
        Of one way out over another (1x1) [m], zero where there is one; normal and point jump where its sign
        changes. None where two ways are not looked for.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX
    lead: ca.SX | None = None


FROM_POINT: dict[ShapeKind, Callable[[ca.SX, Shape], Nearest]] = {
    "sphere": lambda point, sphere: points.to_point(point, sphere.position),
    "capsule": points.to_segment,
    "plane": points.to_plane,
    "box": points.to_box,
    "cylinder": points.to_cylinder,
}
"""From a sphere's centre to the core of another shape."""
ROUND = ("sphere", "capsule")
"""Shapes that are a core with a radius around it."""
CROWN = 1e-3
"""Height of the dome on flat faces and straight edges, of half their length, if nothing says."""


def have_distance(one: ShapeKind, other: ShapeKind) -> bool:
    """Whether two shapes have a distance; planes have none from each other."""
    return (one, other) != ("plane", "plane")


def proximity(
    kinds: tuple[ShapeKind, ShapeKind], one: Shape, other: Shape, crown: ca.SX | float = CROWN
) -> Proximity:
    """How near two shapes are.

    Parameters
    ----------
    kinds
        Theirs.
    one, other
        The shapes.
    crown
        Height of the dome on flat faces and straight edges, of half their length (1x1); without effect where
        one of the two is a sphere.

    Raises
    ------
    ValueError
        If both are planes.
    """
    if not have_distance(*kinds):
        raise ValueError("planes have no distance from each other")
    if kinds[0] == "plane" or (kinds[1] == "sphere" and kinds[0] != "sphere"):
        found = proximity((kinds[1], kinds[0]), other, one, crown)
        return Proximity(found.gap, -found.normal, found.point)
    if kinds[0] == "sphere":
        distance, away, nearest = FROM_POINT[kinds[1]](one.position, other)
        radius = other.radius if kinds[1] in ROUND else ca.SX(0)
        gap = distance - one.radius - radius
        # the surface points are those of the cores, moved by the radii towards each other
        return Proximity(gap, -away, nearest + away * (radius + gap / 2))
    lead = None
    if kinds[1] == "plane":
        gap, away, nearest = crowned.to_plane(kinds[0], one, other, ca.SX(crown))
    else:
        (gap, away, nearest), lead = crowned.to_crowned(kinds, one, other, ca.SX(crown))
    return Proximity(gap, -away, nearest + away * gap / 2, lead)


class Implicit(NamedTuple):
    """What an iteration finds, as a symbol that is held constant in derivatives.

    Attributes
    ----------
    symbol
        Symbol (n x 1); of no length where there is no iteration.
    function
        Finds its value (n x 1) by a fixed number of steps; None where there is none.
    given
        Expression (m x 1) that the function is called with.
    """

    symbol: ca.SX
    function: ca.Function | None
    given: ca.SX


def held_gap(
    kinds: tuple[ShapeKind, ShapeKind], one: Shape, other: Shape, crown: ca.SX | float = CROWN
) -> tuple[ca.SX, Implicit]:
    """Signed distance of two shapes that is cheap to differentiate.

    Parameters
    ----------
    kinds, one, other, crown
        As for :func:`proximity`.

    Returns
    -------
    tuple
        The distance (1x1) [m], and the symbol in it for the direction that an iteration finds: first and
        second derivatives at a constant symbol are the distance's.
    """
    if {"sphere", "plane"} & {*kinds}:
        return proximity(kinds, one, other, crown).gap, Implicit(ca.SX(0, 1), None, ca.SX(0, 1))
    gap, symbol, function, given = crowned.gap_along(kinds, one, other, ca.SX(crown))
    return gap, Implicit(symbol, function, given)
