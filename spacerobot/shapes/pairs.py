"""Signed distance, witness points and approach speed of two shapes."""

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
        gap: Signed distance (1x1) [m], negative while the shapes overlap.
        normal: Unit vector (3x1) from the first to the second, world axes.
        point: Midpoint of the two witness points, which are nearest to each other or deepest in each other
            (3x1) [m].
        lead: Difference of depth between the two shortest ways out of an overlap (1x1) [m], zero if there is
            only one. Normal and point jump where its sign changes. None if a second way is not computed.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX
    lead: ca.SX | None = None


CROWN = 1e-3
"""Default crown: height of the dome on flat faces and straight edges, relative to half their length."""


def have_distance(one: type[ConvexKind], other: type[ConvexKind]) -> bool:
    """Whether two kinds of shapes have a distance: false for two half-spaces."""
    return not (one.is_halfspace and other.is_halfspace)


def proximity(one: Shape, other: Shape, crown: ca.SX | float = CROWN) -> Proximity:
    """Proximity of two shapes.

    The distance of a ball from a shape with a closed form is exact. Other distances follow from the support
    functions of crowned shapes.

    Args:
        one, other: The shapes.
        crown: Height of the dome on flat faces and straight edges, relative to half their length (1x1);
            without effect on exact distances.

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
        # witness points are those of the cores, shifted towards each other by the radii
        return Proximity(gap, -away, nearest + away * (radius + gap / 2))
    lead = None
    if other.kind.is_halfspace:
        gap, away, nearest = crowned.to_plane(one, other, ca.SX(crown))
    else:
        (gap, away, nearest), lead = crowned.to_shape(one, other, ca.SX(crown))
    return Proximity(gap, -away, nearest + away * gap / 2, lead)


def approach_speed(shapes: Sequence[MovingShape], crown: ca.SX | float = CROWN) -> ca.SX:
    """Upper bound of the rate of change of the gap of two moving shapes (1x1) [m/s].

    Let p1 and p2 be the witness points, n the unit vector from p1 to p2, c1 and c2 the shapes' origins, and
    v1 and v2 the velocity fields of the bodies. The gap's rate is ``n.(v2(p2) - v1(p1))``. Since p2 - p1 is
    along n, it equals ``n.w(p2)`` with the relative velocity field w = v2 - v1, that is, with
    omega = omega_2 - omega_1, ``n.(w(c2) + omega x (p2 - c2))``. The ball's part of p2 - c2 is along n and
    does not contribute. With r2, the radius about c2 of the shape without its ball, the rate is bounded by
    ``|w(c2)| + |omega| r2``. A second bound exchanges the shapes, and a third is
    ``|v2(c2) - v1(c1)| + |omega_1| r1 + |omega_2| r2``. None depends on the witness points.

    Args:
        shapes: The two shapes and their motions; at most one is a half-space.
        crown: Height of the dome on flat faces and straight edges, relative to half their length (1x1).

    Returns:
        ca.SX: The smallest of these bounds.
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
    """A shape that moves with its body, world axes.

    Attributes:
        shape: The shape.
        linear, angular: Velocity of the shape's origin (3x1) [m/s] and angular velocity (3x1) [rad/s].
    """

    shape: Shape
    linear: ca.SX
    angular: ca.SX

    def velocity(self, point: ca.SX) -> ca.SX:
        """Velocity (3x1) [m/s] of the body's material point at a position (3x1) [m]."""
        return self.linear + cross(self.angular, point - self.shape.position)


def core_radius(shape: Shape, crown: ca.SX | float) -> ca.SX | None:
    """Radius (1x1) [m], about its origin, of a sphere around a shape without its ball; None for a half-space.

    A support function h is sublinear: ``h(n) <= sum |n_i| h(+-e_i)``. By Cauchy and Schwarz, the norm of the
    vector of max(h(e_i), h(-e_i)) bounds it.
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
    """Result of an iteration, as a symbol that derivatives hold constant.

    Attributes:
        symbol: Symbol of the result (n x 1); empty if the distance needs no iteration.
        function: Function that evaluates the result (n x 1) by a fixed number of steps, or None.
        arguments: Arguments of the function as an expression (m x 1).
        ascent: Function of one step, called with the arguments and a direction (3 x 1). For separated shapes,
            these steps reach the result from any direction. None unless a term is sharp and none has a
            memory; see :mod:`spacerobot.shapes.crowned`.
    """

    symbol: ca.SX
    function: ca.Function | None
    arguments: ca.SX
    ascent: ca.Function | None = None


def held_gap(one: Shape, other: Shape, crown: ca.SX | float = CROWN) -> tuple[ca.SX, Implicit]:
    """Signed distance of two shapes for repeated differentiation.

    The direction that an iteration finds is a symbol of the expression. First and second derivatives of the
    expression with this symbol held constant are those of the distance.

    Args:
        one, other, crown: As for :func:`proximity`.

    Returns:
        tuple: The distance (1x1) [m], and the symbol with the iteration that evaluates it.
    """
    if is_exact(one, other) or one.kind.is_halfspace or other.kind.is_halfspace:
        return proximity(one, other, crown).gap, Implicit(ca.SX(0, 1), None, ca.SX(0, 1))
    gap, symbol, function, arguments, ascent = crowned.gap_along(one, other, ca.SX(crown))
    return gap, Implicit(symbol, function, arguments, ascent)


def is_exact(one: Shape, other: Shape) -> bool:
    """Whether the distance has a closed form: one shape is a ball, the other has one for points."""
    if other.is_ball and not one.is_ball:
        one, other = other, one
    return one.is_ball and other.kind.nearest(one.position, other) is not None
