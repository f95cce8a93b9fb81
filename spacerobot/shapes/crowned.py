"""Signed distance of crowned shapes: any two of a capsule, a cylinder, a box, and of one from a half-space.

Each is a Minkowski sum of segments, a disc and a ball. Its support function, how far it reaches along n, is
the sum of terms ``size |u|``, where u is the part of n along a segment's axis, or across a disc's. It has a
kink where u = 0: there a whole face or edge is farthest. Crowned, a term is ``size sqrt(|u|^2 + crown^2)``,
which domes faces and edges by ``crown size`` and makes the farthest point unique, inside the face.

The signed distance of two convex shapes, apart or not, is the maximum over unit vectors n of ``n.c - h(n)``,
with c from one centre to the other and h the sum of both support functions. It is found by a fixed number of
Newton steps on the sphere. In their Hessian one of two factors u over its length is that foreseen by the step
before (Chan, Golub and Mulet 1999), so that they converge however small the crown is.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.dynamics.algebra import cross
from spacerobot.shapes.points import TINY, Nearest, clamp
from spacerobot.shapes.shape import Shape, ShapeKind

_STEPS, _STEPS_ROUND = 12, 14
"""How many steps, without discs and with them."""
_LONGEST, _SHORTER, _WORSE = 1.0, 0.2, 1e-12
"""[rad] Longest step; part of it that is taken where all of it lowers the value by more than so much [m]."""
_CURVED = 0.03
"""Least curvature of what is maximised that a step reckons with, of the depth; inside there are saddles."""
_APART = 0.03
"""[rad] Ways out nearer to each other are one."""
_FAR = 1e9
"""[m] More than any depth."""
_ASIDE = ca.DM([0.6e-9, 0.48e-9, 0.64e-9])
"""Added to a direction that may be none."""


@dataclass(frozen=True)
class CrownPart:
    """A segment along an axis (3x1), or a disc across it, of half length or radius ``size`` (1x1) [m]."""

    size: ca.SX
    axis: ca.SX
    disc: bool

    def seen(self, n: ca.SX) -> ca.SX:
        """What it sees of a direction (3x1): its part along or across the axis."""
        along = ca.dot(self.axis, n) * self.axis
        return n - along if self.disc else along

    def square(self, n: ca.SX) -> ca.SX:
        """Square of what it sees of a unit vector (1x1)."""
        along = ca.dot(self.axis, n)
        return ca.fmax(1 - along**2, 0) if self.disc else along**2


def parts_of(kind: ShapeKind, shape: Shape, rotation: ca.SX) -> list[CrownPart]:
    """Segments and disc of a shape that is turned (3x3)."""
    if kind == "box":
        return [CrownPart(shape.half[i], rotation[:, i], False) for i in range(3)]
    parts = [CrownPart(shape.half, rotation[:, 2], False)]
    return [*parts, CrownPart(shape.radius, rotation[:, 2], True)] if kind == "cylinder" else parts


def ball_of(kind: ShapeKind, shape: Shape) -> ca.SX:
    """Radius of the ball of a shape (1x1) [m]."""
    return shape.radius if kind == "capsule" else ca.SX(0)


def to_plane(kind: ShapeKind, shape: Shape, plane: Shape, crown: ca.SX) -> Nearest:
    """From a crowned shape to a half-space."""
    down = -plane.axis
    reach = _Reach(shape.position, parts_of(kind, shape, shape.rotation), ball_of(kind, shape), crown)
    low = shape.position + reach.farthest(down)
    distance = ca.dot(plane.axis, low - plane.position)
    return distance, plane.axis, low - distance * plane.axis


def to_crowned(
    kinds: tuple[ShapeKind, ShapeKind], one: Shape, other: Shape, crown: ca.SX
) -> tuple[Nearest, ca.SX | None]:
    """From a crowned shape to another one, and which of two ways out is the shorter.

    Apart it is the distance; inside, the shortest way out as long as that is short beside the shapes, else
    one of several that are locally the shortest. Where the last (1x1, None without discs) changes its sign
    the way out jumps to another one that is as short; it is zero where there is one way.
    """
    turn, centre = ca.mtimes(one.rotation.T, other.rotation), one.inside(other.position)
    sizes = one.radius, one.half, other.radius, other.half
    gap, normal, nearest, lead = _nearest(kinds)(turn, centre, *sizes, crown)
    found = gap, -one.outside(normal), one.position + one.outside(nearest)
    return found, lead if "cylinder" in kinds else None


def gap_along(
    kinds: tuple[ShapeKind, ShapeKind], one: Shape, other: Shape, crown: ca.SX
) -> tuple[ca.SX, ca.SX, ca.Function, ca.SX]:
    """Signed distance (1x1) [m] as a function of both poses for a given normal.

    The distance is the maximum of V(x, n) over unit vectors n. With n = (n0 + T' d) / |n0 + T' d|, n0 the
    maximum, and M0 = -V_dd there, both held constant, one Newton step

        d(x) = M0^-1 V_d(x, 0)

    gives a value V(x, d(x)) whose first derivative at the pose of n0 and M0 is V_x (V_d vanishes there), and
    whose second one is V_xx + V_xd M0^-1 V_dx: both are the distance's.

    Returns
    -------
    tuple
        The distance; a symbol (6x1) for n0 in the first shape's axes and the entries 11, 12, 22 of M0^-1; the
        function that finds them, and what it is given.
    """
    symbol = ca.SX.sym("normal", 6)
    given = [
        ca.mtimes(one.rotation.T, other.rotation),
        one.inside(other.position),
        one.radius,
        one.half,
        other.radius,
        other.half,
        crown,
    ]
    value, slope, step = _reach_between(kinds, *given)[0].about(symbol[:3])
    a, b, c = (symbol[k] for k in (3, 4, 5))
    pull = ca.substitute(slope, step, ca.SX.zeros(2))
    newton = ca.vertcat(a * pull[0] + b * pull[1], b * pull[0] + c * pull[1])
    flat = ca.vertcat(*(ca.densify(ca.vec(one)) for one in given))
    return ca.substitute(value, step, newton), symbol, _maximum(kinds), flat


@functools.cache
def _nearest(kinds: tuple[ShapeKind, ShapeKind]) -> ca.Function:
    """Gap, normal and the second's nearest point, in the axes of the first, which has structural zeros.

    And the lead of one way out over another.
    """
    given = _symbols(kinds)
    _, centre, *_, crown = given
    reach, own, others, ball = _reach_between(kinds, *given)
    normal, lead = reach.best(_directions(centre, own, others))
    nearest = centre - _Reach(centre, others, ball, crown).farthest(normal)
    return ca.Function("near", given, ca.cse([reach.value(normal), normal, nearest, lead]))


@functools.cache
def _maximum(kinds: tuple[ShapeKind, ShapeKind]) -> ca.Function:
    """Normal in the first's axes, and the inverse of minus the value's second derivative there (6x1)."""
    given = _symbols(kinds)
    normal = ca.SX.sym("normal", 3)
    reach, own, others, _ = _reach_between(kinds, *given)
    value, slope, step = reach.about(normal)
    bent = -ca.jacobian(slope, step)
    gap, bend = ca.substitute([value, ca.densify(bent)], [step], [ca.SX.zeros(2)])
    inverse = ca.Function("inverse", [*given, normal], [_inverse((bend[0, 0], bend[0, 1], bend[1, 1]), gap)])
    flat = ca.SX.sym("given", sum(one.numel() for one in given))
    ends = np.cumsum([0, *(one.numel() for one in given)])
    parts = [
        ca.reshape(flat[int(a) : int(b)], one.shape)
        for a, b, one in zip(ends[:-1], ends[1:], given, strict=True)
    ]
    # without common parts taken out, which takes longer than it saves where nothing is compiled
    best = ca.Function("best", given, [reach.best(_directions(given[1], own, others))[0]])
    found = best(*parts)
    name = f"maximum_{kinds[0]}_{kinds[1]}"
    return ca.Function(name, [flat], [ca.vertcat(found, inverse(*parts, found))], ["given"], ["found"])


def _symbols(kinds: tuple[ShapeKind, ShapeKind]) -> list[ca.SX]:
    """Turn and centre of the second in the axes of the first, radius and size of each, and the crown."""
    radii = [ca.SX.sym("radius") for _ in kinds]
    sizes = [ca.SX.sym("size", 3 if kind == "box" else 1) for kind in kinds]
    of_shapes = (radii[0], sizes[0], radii[1], sizes[1])
    return [ca.SX.sym("turn", 3, 3), ca.SX.sym("centre", 3), *of_shapes, ca.SX.sym("crown")]


def _reach_between(
    kinds: tuple[ShapeKind, ShapeKind],
    turn: ca.SX,
    centre: ca.SX,
    *measures: ca.SX,
) -> tuple[_Reach, list[CrownPart], list[CrownPart], ca.SX]:
    """Sum of two shapes in the axes of the first, the parts of each, and the second's ball."""
    *sizes, crown = measures
    here = Shape(ca.SX.eye(3), ca.SX(3, 1), *sizes[:2]), Shape(turn, centre, *sizes[2:])
    own, others = (parts_of(kind, shape, shape.rotation) for kind, shape in zip(kinds, here, strict=True))
    balls = [ball_of(kind, shape) for kind, shape in zip(kinds, here, strict=True)]
    return _Reach(centre, [*own, *others], balls[0] + balls[1], crown), own, others, balls[1]


def _directions(centre: ca.SX, own: Sequence[CrownPart], others: Sequence[CrownPart]) -> Iterator[ca.SX]:
    """Directions (3x1) in which the way out may be the shortest: of axes, across two of them, radial."""
    axes = [[part.axis for part in parts if not part.disc] for parts in (own, others)]
    yield from (*axes[0], *axes[1])
    yield from (cross(a, b) for a, b in itertools.product(*axes))
    yield from (part.seen(centre) for part in (*own, *others) if part.disc)


@dataclass(frozen=True)
class _Reach:
    """Value n.c - h(n) of a Minkowski sum about the origin, seen from a centre (3x1) [m]."""

    centre: ca.SX
    parts: list[CrownPart]
    ball: ca.SX
    crown: ca.SX

    @property
    def has_disc(self) -> bool:
        """Whether one of its parts is a disc."""
        return any(part.disc for part in self.parts)

    def value(self, n: ca.SX) -> ca.SX:
        """How far apart they are along a unit vector (1x1) [m]."""
        lengths = (part.size * ca.sqrt(part.square(n) + self.crown**2) for part in self.parts)
        return ca.dot(n, self.centre) - sum(lengths, self.ball)

    def farthest(self, n: ca.SX) -> ca.SX:
        """Point of the sum that is farthest along a unit vector (3x1) [m]."""
        point = self.ball * n
        for part in self.parts:
            seen = part.seen(n)
            length = ca.sqrt(ca.dot(seen, seen) + self.crown**2)
            point = point + part.size * (seen + self.crown**2 * n) / length
        return point

    def best(self, directions: Iterator[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Unit vector (3x1) at which the value is greatest, from where it is greatest of some directions.

        With discs, also from the next best: of two ways out that are nearly as short either may be shorter.
        The lead (1x1) [m] of one over the other comes along; which one is told by where they point.
        """
        first = second = _unit(self.centre)
        value, next_value = self.value(first), ca.SX(-_FAR)
        for direction in directions:
            n = _unit(ca.if_else(ca.dot(direction, self.centre) < 0, -1, 1) * direction)
            other = self.value(n)
            better, good = other > value, other > next_value
            second = ca.if_else(better, first, ca.if_else(good, n, second))
            next_value = ca.fmax(ca.fmin(value, other), next_value)
            first, value = ca.if_else(better, n, first), ca.fmax(value, other)
        found, lead = self.climb(first), ca.SX(0)
        if self.has_disc:
            other = self.climb(second)
            value, next_value = self.value(found), self.value(other)
            apart = found - other
            side = ca.if_else(ca.dot(_ASIDE, apart) < 0, -1, 1)
            lead = ca.if_else(ca.dot(apart, apart) > _APART**2, side * (value - next_value), 0)
            found = ca.if_else(next_value > value, other, found)
        return found, lead

    def climb(self, n: ca.SX) -> ca.SX:
        """Unit vector (3x1) after steps towards a greater value."""
        held = [ca.SX.zeros(3 if part.disc else 1) for part in self.parts]
        for _ in range(_STEPS_ROUND if self.has_disc else _STEPS):
            n, *held = self._stepping(n, *held, *self._free)
        return n

    def about(self, n: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Value around a unit vector, its slope (2x1), and the symbol (2x1) of the step across it."""
        step = ca.SX.sym("step", 2)
        value = self.value(_scaled(n + ca.mtimes(_tangents(n).T, step)))
        return value, ca.gradient(value, step), step

    @functools.cached_property
    def _free(self) -> list[ca.SX]:
        """Symbols of which all is made."""
        axes = (part.axis for part in self.parts)
        return ca.symvar(ca.vertcat(self.centre, *axes, *(p.size for p in self.parts), self.ball, self.crown))

    @functools.cached_property
    def _stepping(self) -> ca.Function:
        """One step as a function, which takes less time to repeat than its expressions to build."""
        n = ca.SX.sym("n", 3)
        held = [ca.SX.sym("held", 3 if part.disc else 1) for part in self.parts]
        step, ahead = self._step(n, held)
        whole = _scaled(n + step)
        if self.has_disc:  # else all of it never does harm
            worse = self.value(whole) < self.value(n) - _WORSE
            whole = ca.if_else(worse, _scaled(n + _SHORTER * step), whole)
        return ca.Function("step", [n, *held, *self._free], [whole, *ahead])

    def _step(self, n: ca.SX, held: Sequence[ca.SX]) -> tuple[ca.SX, list[ca.SX]]:
        """Step on the sphere (3x1), and u over its length of each part, as it will be."""
        plane = _tangents(n)
        pull, bend = ca.mtimes(plane, self.centre), [self.ball, ca.SX(0), self.ball]  # minus the Hessian
        for part, old in zip(self.parts, held, strict=True):
            along, across = ca.dot(part.axis, n), ca.mtimes(plane, part.axis)
            length = ca.sqrt(part.square(n) + self.crown**2)
            # u along the tangents, now and as it was foreseen, the latter over its length
            now, sign = (-along if part.disc else along) * across, -1 if part.disc else 1
            before = ca.mtimes(plane, old) if part.disc else old * across
            pull = pull - part.size / length * now
            for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1))):
                flat = (now[i] * before[j] + now[j] * before[i]) / (2 * length)
                curved = (i == j) * (self.crown**2 + part.disc) + sign * across[i] * across[j] - flat
                bend[k] = bend[k] + part.size / length * curved
        step = ca.mtimes(plane.T, _solved(bend, self.value(n), pull))
        return step, [self._held(part, n, step, old) for part, old in zip(self.parts, held, strict=True)]

    def _held(self, part: CrownPart, n: ca.SX, step: ca.SX, old: ca.SX) -> ca.SX:
        """What a part sees over its length after a step: along a segment (1x1), across a disc (3x1)."""
        length = ca.sqrt(part.square(n) + self.crown**2)
        along, further = ca.dot(part.axis, n), ca.dot(part.axis, step)
        if not part.disc:
            return clamp((along + further - old * along * further / length) / length, ca.SX(1))
        new = (part.seen(n) + part.seen(step) + old * along * further / length) / length
        return new / ca.fmax(1, ca.sqrt(ca.dot(new, new) + TINY))


def _solved(bend: Sequence[ca.SX], value: ca.SX, pull: ca.SX) -> ca.SX:
    """Newton step in the tangent plane (2x1); the sphere adds the value to minus the Hessian."""
    middle, half = (bend[0] + bend[2]) / 2, (bend[0] - bend[2]) / 2
    least = middle - ca.sqrt(half**2 + bend[1] ** 2 + TINY)
    add = ca.if_else(value > 0, value, ca.fmax(value, -least - _CURVED * value)) + _WORSE
    a, b, c = bend[0] + add, bend[1], bend[2] + add
    step = ca.vertcat(c * pull[0] - b * pull[1], a * pull[1] - b * pull[0]) / (a * c - b**2)
    return step * ca.fmin(1, _LONGEST / ca.sqrt(ca.dot(step, step) + TINY))


def _inverse(bend: Sequence[ca.SX], value: ca.SX) -> ca.SX:
    """Entries 11, 12, 22 of the inverse of minus a second derivative (3x1), kept positive as in a step."""
    middle, half = (bend[0] + bend[2]) / 2, (bend[0] - bend[2]) / 2
    least = middle - ca.sqrt(half**2 + bend[1] ** 2 + TINY)
    add = ca.if_else(value > 0, 0, ca.fmax(0, -least - _CURVED * value)) + _WORSE
    a, b, c = bend[0] + add, bend[1], bend[2] + add
    return ca.vertcat(c, -b, a) / (a * c - b**2)


def _tangents(n: ca.SX) -> ca.SX:
    """Two unit vectors across a unit vector and each other (2x3), by Duff et al. 2017."""
    side = ca.if_else(n[2] < 0, -1, 1)
    a = -1 / (side + n[2])
    b = n[0] * n[1] * a
    rows = (1 + side * a * n[0] ** 2, side * b, -side * n[0]), (b, side + a * n[1] ** 2, -n[1])
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _unit(direction: ca.SX) -> ca.SX:
    """Unit vector along a direction (3x1); almost along it where it may be none."""
    return _scaled(direction + _ASIDE)


def _scaled(direction: ca.SX) -> ca.SX:
    """Unit vector along a direction (3x1)."""
    return direction / ca.sqrt(ca.dot(direction, direction))
