"""Proximity of two shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from spacerobot.dynamics.algebra import cross
from spacerobot.shapes import crowned
from spacerobot.shapes.shape import ConvexKind, Shape


@dataclass(frozen=True)
class Proximity:
    """Distance of two shapes, and its witness points.

    Attributes:
        gap: Signed distance (1x1) [m], negative where they overlap.
        normal: Unit vector (3x1) from the first to the second.
        point: Halfway between the two points that are nearest to each other, or deepest in each other (3x1)
            [m].
        lead: Of one way out over another (1x1) [m], zero where there is one; normal and point jump where its
            sign changes. None where two ways are not looked for.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX
    lead: ca.SX | None = None


CROWN = 1e-3
"""Height of the dome on flat faces and straight edges, of half their length, if nothing says."""


def have_distance(one: type[ConvexKind], other: type[ConvexKind]) -> bool:
    """Whether two kinds of shapes have a distance; half-spaces have none from each other."""
    return not (one.is_halfspace and other.is_halfspace)


def proximity(one: Shape, other: Shape, crown: ca.SX | float = CROWN) -> Proximity:
    """Proximity of two shapes.

    A ball's distance from a shape whose kind has a closed form is exact; otherwise support functions decide.

    Args:
        one, other: The shapes.
        crown: Height of the dome on flat faces and straight edges, of half their length (1x1); without effect
            where the distance is exact.

    Raises:
        ValueError: If both are half-spaces.
    """
    if not have_distance(one.kind, other.kind):
        raise ValueError("half-spaces have no distance from each other")
    if one.kind.is_halfspace or (other.is_ball and not one.is_ball):
        swapped = proximity(other, one, crown)
        return Proximity(swapped.gap, -swapped.normal, swapped.point, swapped.lead)
    exact = other.kind.nearest(one.position, other) if one.is_ball else None
    if exact is not None:
        distance, away, nearest = exact
        radius = other.support.ball
        gap = distance - one.support.ball - radius
        # the surface points are those of the cores, moved by the radii towards each other
        return Proximity(gap, -away, nearest + away * (radius + gap / 2))
    lead = None
    if other.kind.is_halfspace:
        gap, away, nearest = crowned.to_plane(one, other, ca.SX(crown))
    else:
        (gap, away, nearest), lead = crowned.to_shape(one, other, ca.SX(crown))
    return Proximity(gap, -away, nearest + away * gap / 2, lead)


def approach_speed(shapes: Sequence[MovingShape], crown: ca.SX | float = CROWN) -> ca.SX:
    """Upper bound of the rate of the gap of two moving shapes (1x1) [m/s].

    With the nearest points p1 and p2, the unit vector n from p1 to p2, and the bodies' velocity fields v1 and
    v2, the gap's rate is ``n.(v2(p2) - v1(p1))``. Since p2 - p1 is along n, this is ``n.w(p2)``, where
    w = v2 - v1 is the second's motion relative to the first, with omega = omega_2 - omega_1:
    ``n.(w(c2) + omega x (p2 - c2))``. A ball's part of p2 - c2 is along n, so that with r2, the radius about
    c2 of the shape without its ball, the rate is at most ``|w(c2)| + |omega| r2``. Likewise about c1; and at
    most ``|v2(c2) - v1(c1)| + |omega_1| r1 + |omega_2| r2``. None depends on where the nearest points are.

    Args:
        shapes: The two shapes and their motions; at most one is a half-space.
        crown: Height of the dome on flat faces and straight edges, of half their length (1x1).

    Returns:
        ca.SX: The least of these bounds.
    """
    one, other = shapes
    turning = ca.norm_2(other.angular - one.angular)
    bounds, radii = [], [core_radius(moving.shape, crown) for moving in shapes]
    for moving, radius in zip(shapes, radii, strict=True):
        if radius is not None:
            centre = moving.shape.position
            bounds.append(ca.norm_2(other.velocity(centre) - one.velocity(centre)) + turning * radius)
    if radii[0] is not None and radii[1] is not None:
        apart = ca.norm_2(other.linear - one.linear)
        bounds.append(apart + ca.norm_2(one.angular) * radii[0] + ca.norm_2(other.angular) * radii[1])
    return ca.mmin(ca.vertcat(*bounds))


@dataclass(frozen=True)
class MovingShape:
    """A shape that moves with its body.

    Attributes:
        shape: The shape, world axes.
        linear, angular: Velocity of its origin (3x1) [m/s] and angular velocity (3x1) [rad/s], world axes.
    """

    shape: Shape
    linear: ca.SX
    angular: ca.SX

    def velocity(self, point: ca.SX) -> ca.SX:
        """Velocity (3x1) [m/s] of its material point at a point (3x1) [m]."""
        return self.linear + cross(self.angular, point - self.shape.position)


def core_radius(shape: Shape, crown: ca.SX | float) -> ca.SX | None:
    """Radius (1x1) [m] about its origin that holds a shape without its ball; None for a half-space.

    A support function h is sublinear: ``h(n) <= sum |n_i| h(+-e_i)``, so that the norm of its greatest values
    along three axes bounds it.
    """
    if shape.kind.is_halfspace:
        return None
    terms, axes = shape.kind.support(ca.SX.eye(3), shape.measures).terms, ca.SX.eye(3)
    reaches = [
        [sum((term.reach(side * axes[:, i], ca.SX(crown)) for term in terms), ca.SX(0)) for side in (1, -1)]
        for i in range(3)
    ]
    return ca.norm_2(ca.vertcat(*(ca.fmax(*pair) for pair in reaches)))


class Implicit(NamedTuple):
    """Result of an iteration, as a symbol that is held constant in derivatives.

    Attributes:
        symbol: Symbol (n x 1); of no length where there is no iteration.
        function: Finds its value (n x 1) by a fixed number of steps; None where there is none.
        given: Expression (m x 1) that the function is called with.
        ascent: One step of the iteration, called with the same and a direction (3 x 1), which alone leads
            there where shapes are apart; see :func:`spacerobot.shapes.crowned.gap_along`. None where it may
            not.
    """

    symbol: ca.SX
    function: ca.Function | None
    given: ca.SX
    ascent: ca.Function | None = None


def held_gap(one: Shape, other: Shape, crown: ca.SX | float = CROWN) -> tuple[ca.SX, Implicit]:
    """Signed distance of two shapes that is cheap to differentiate.

    Args:
        one, other, crown: As for :func:`proximity`.

    Returns:
        tuple: The distance (1x1) [m], and the symbol in it for the direction that an iteration finds: first
            and second derivatives at a constant symbol are the distance's.
    """
    if is_exact(one, other) or one.kind.is_halfspace or other.kind.is_halfspace:
        return proximity(one, other, crown).gap, Implicit(ca.SX(0, 1), None, ca.SX(0, 1))
    gap, symbol, function, arguments, ascent = crowned.gap_along(one, other, ca.SX(crown))
    return gap, Implicit(symbol, function, arguments, ascent)


def is_exact(one: Shape, other: Shape) -> bool:
    """Whether the distance of two shapes has a closed form: one is a ball, and the other's kind has one."""
    if other.is_ball and not one.is_ball:
        one, other = other, one
    return one.is_ball and other.kind.nearest(one.position, other) is not None
