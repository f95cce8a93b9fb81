"""Signed distance of any two convex shapes by their support functions, and of one from a half-space.

The signed distance of two convex shapes, apart or not, is the maximum over unit vectors n of ``n.c - h(n)``,
with c from one centre to the other and h(n) the sum of the first one's support function and, at -n, the
second one's. It is found by a fixed
number of Newton steps on the sphere. In their Hessian one of two factors u over its length of a crowned term
is that foreseen by the step before (Chan, Golub and Mulet 1999), so that they converge however small the
crown is.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.dynamics.algebra import cross
from spacerobot.shapes.clamp import TINY
from spacerobot.shapes.shape import ConvexKind, Nearest, Shape
from spacerobot.shapes.support import Support, Term

_STEPS, _STEPS_ROUND = 12, 14
"""How many steps, without curved terms and with them."""
_STEPS_SHARP = 30
"""How many with sharp terms."""
_LONGEST, _SHORTER, _SHORTER_SHARP, _WORSE = 1.0, 0.2, 0.1, 1e-12
"""[rad] Longest step; part of it that is taken where all of it lowers the value by more than so much [m], and
with sharp terms."""
_CURVED = 0.03
"""Least curvature of what is maximised that a step reckons with, of the depth; inside there are saddles."""
_APART = 0.03
"""[rad] Ways out nearer to each other are one."""
_FAR = 1e9
"""[m] More than any depth."""
_ASIDE = ca.DM([0.6e-9, 0.48e-9, 0.64e-9])
"""Added to a direction that may be none."""


def to_plane(shape: Shape, plane: Shape, crown: ca.SX) -> Nearest:
    """Proximity of a shape and a half-space."""
    low = shape.position + _Reach.of(shape.position, crown, shape.support).farthest(-plane.axis)
    distance = ca.dot(plane.axis, low - plane.position)
    return distance, plane.axis, low - distance * plane.axis


def to_shape(one: Shape, other: Shape, crown: ca.SX) -> tuple[Nearest, ca.SX | None]:
    """Proximity of two shapes, and which of two ways out is the shorter.

    Apart it is the distance; inside, the shortest way out as long as that is short beside the shapes, else
    one of several that are locally the shortest. Where the last (1x1, None without curved terms) changes its
    sign the way out jumps to another one that is as short; it is zero where there is one way.
    """
    turn, centre = ca.mtimes(one.rotation.T, other.rotation), one.inside(other.position)
    near = _nearest(*_pair(one, other))
    gap, normal, nearest, lead = near(turn, centre, one.measures, other.measures, crown)
    nearest_points = gap, -one.outside(normal), one.position + one.outside(nearest)
    curved = any(term.is_curved for shape in (one, other) for term in shape.support.terms)
    return nearest_points, lead if curved else None


def gap_along(
    one: Shape, other: Shape, crown: ca.SX
) -> tuple[ca.SX, ca.SX, ca.Function, ca.SX, ca.Function | None]:
    """Signed distance (1x1) [m] as a function of both poses for a given normal.

    The distance is the maximum of V(x, n) over unit vectors n. With n = (n0 + T' d) / |n0 + T' d|, n0 the
    maximum, and M0 = -V_dd there, both held constant, one Newton step

        d(x) = M0^-1 V_d(x, 0)

    gives a value V(x, d(x)) whose first derivative at the pose of n0 and M0 is V_x (V_d vanishes there), and
    whose second one is V_xx + V_xd M0^-1 V_dx: both are the distance's.

    Returns:
        tuple: The distance; a symbol (6x1) for n0 in the first shape's axes and the entries 11, 12, 22 of
            M0^-1; the function that finds them, what it is given, and one step of it where such steps alone
            find them for shapes that are apart.
    """
    kinds, sizes = _pair(one, other)
    symbol = ca.SX.sym("normal", 6)
    turn, centre = ca.mtimes(one.rotation.T, other.rotation), one.inside(other.position)
    inputs = [turn, centre, one.measures, other.measures, crown]
    value, slope, step = _reach_between(kinds, inputs)[0].about(symbol[:3])
    a, b, c = (symbol[k] for k in (3, 4, 5))
    pull = ca.substitute(slope, step, ca.SX.zeros(2))
    newton = ca.vertcat(a * pull[0] + b * pull[1], b * pull[0] + c * pull[1])
    flat = ca.vertcat(*(ca.densify(ca.vec(one)) for one in inputs))
    gap = ca.substitute(value, step, newton)
    return gap, symbol, _maximum(kinds, sizes), flat, _ascent(kinds, sizes)


_Kinds = tuple[type[ConvexKind], type[ConvexKind]]
_Sizes = tuple[int, int]


def _pair(one: Shape, other: Shape) -> tuple[_Kinds, _Sizes]:
    """Kinds of two shapes, and how many measures each has."""
    return (one.kind, other.kind), (one.measures.numel(), other.measures.numel())


@functools.cache
def _nearest(kinds: _Kinds, sizes: _Sizes) -> ca.Function:
    """Function for the gap, the normal and the second shape's nearest point, in the axes of the first shape.

    The last output is the difference between the two shortest ways out of an overlap.
    """
    inputs = _symbols(sizes)
    _, centre, *_, crown = inputs
    reach, first, others = _reach_between(kinds, inputs)
    normal, lead = reach.best(_directions(centre, first.terms, others.terms))
    nearest = centre - _Reach.of(centre, crown, others).farthest(normal)
    return ca.Function("near", inputs, ca.cse([reach.value(normal), normal, nearest, lead]))


@functools.cache
def _maximum(kinds: _Kinds, sizes: _Sizes) -> ca.Function:
    """Normal in the first's axes, and the inverse of minus the value's second derivative there (6x1)."""
    inputs = _symbols(sizes)
    normal = ca.SX.sym("normal", 3)
    reach, first, others = _reach_between(kinds, inputs)
    value, slope, step = reach.about(normal)
    bent = -ca.jacobian(slope, step)
    gap, bend = ca.substitute([value, ca.densify(bent)], [step], [ca.SX.zeros(2)])
    inverse = ca.Function("inverse", [*inputs, normal], [_inverse((bend[0, 0], bend[0, 1], bend[1, 1]), gap)])
    flat = ca.SX.sym("given", sum(one.numel() for one in inputs))
    ends = np.cumsum([0, *(one.numel() for one in inputs)])
    parts = [
        ca.reshape(flat[int(a) : int(b)], one.shape)
        for a, b, one in zip(ends[:-1], ends[1:], inputs, strict=True)
    ]
    # without common parts taken out, which takes longer than it saves where nothing is compiled
    best = ca.Function("best", inputs, [reach.best(_directions(inputs[1], first.terms, others.terms))[0]])
    summit = best(*parts)
    name = "_".join(["maximum", *(kind.__name__.lower() for kind in kinds)])
    return ca.Function(name, [flat], [ca.vertcat(summit, inverse(*parts, summit))], ["given"], ["found"])


@functools.cache
def _ascent(kinds: _Kinds, sizes: _Sizes) -> ca.Function | None:
    """One Newton step to the maximum, of what :func:`_maximum` is given; None where steps have a memory.

    The value is the lower bound n.c - h(n) of a concave function of n in space: where it is positive there is
    one maximum on the sphere, whatever the first direction. The function takes a unit vector n too, or zeros
    for that to the second shape's centre. Its result (11x1) is the vector after the step, what ``_maximum``
    finds if n is the maximum, the value [m] and its slope [m] at n.
    """
    inputs = _symbols(sizes)
    reach = _reach_between(kinds, inputs)[0]
    memory = [term.first_memory() for term in reach.terms]
    if not reach.is_sharp or any(one.numel() for one in memory):
        return None
    given = ca.SX.sym("n", 3)
    n = ca.if_else(ca.dot(given, given) > 0, given, _unit(reach.centre))
    normal = ca.SX.sym("normal", 3)
    value, slope, step = reach.about(normal)
    bent = -ca.jacobian(slope, step)
    at = ca.substitute([value, ca.densify(slope), ca.densify(bent)], [step], [ca.SX.zeros(2)])
    inverse = _inverse((at[2][0, 0], at[2][0, 1], at[2][1, 1]), at[0])
    found = ca.vertcat(normal, inverse, at[0], ca.norm_2(at[1]))
    here = ca.Function("here", [*inputs, normal], [found])(*inputs, n)
    flat = ca.vertcat(*(ca.vec(one) for one in inputs))
    after = reach._stepping(n, *memory, *reach._free)[0]
    whole = ca.vertcat(after, here)
    name = "_".join(["ascent", *(kind.__name__.lower() for kind in kinds)])
    return ca.Function(name, [flat, given], [ca.densify(ca.cse(whole))])


def _symbols(sizes: _Sizes) -> list[ca.SX]:
    """Turn and centre of the second in the axes of the first, measures of each, and the crown."""
    measures = [ca.SX.sym("measures", size) for size in sizes]
    return [ca.SX.sym("turn", 3, 3), ca.SX.sym("centre", 3), *measures, ca.SX.sym("crown")]


def _reach_between(kinds: _Kinds, given: Sequence[ca.SX]) -> tuple[_Reach, Support, Support]:
    """Sum of two shapes in the axes of the first, and the support functions of each."""
    turn, centre, *measures, crown = given
    first = kinds[0].support(ca.SX.eye(3), measures[0])
    others = kinds[1].support(turn, measures[1]).reflected()  # its reach towards the first one
    return _Reach.of(centre, crown, first, others), first, others


def _directions(centre: ca.SX, own: Sequence[Term], others: Sequence[Term]) -> Iterator[ca.SX]:
    """Directions (3x1) in which the way out may be the shortest: of axes, across two of them, radial."""
    axes = [[axis for term in terms for axis in term.axes()] for terms in (own, others)]
    yield from (*axes[0], *axes[1])
    yield from (cross(a, b) for a, b in itertools.product(*axes))
    yield from (direction for term in (*own, *others) for direction in term.radial(centre))


@dataclass(frozen=True)
class _Reach:
    """Value n.c - h(n) of a Minkowski sum about the origin, seen from a centre (3x1) [m]."""

    centre: ca.SX
    terms: tuple[Term, ...]
    ball: ca.SX
    crown: ca.SX

    @classmethod
    def of(cls, centre: ca.SX, crown: ca.SX, *supports: Support) -> _Reach:
        """Reach of the Minkowski sum of supports, about a centre."""
        terms = tuple(term for support in supports for term in support.terms)
        return cls(centre, terms, sum((support.ball for support in supports), ca.SX(0)), crown)

    @property
    def is_curved(self) -> bool:
        """Whether one of its terms is curved."""
        return any(term.is_curved for term in self.terms)

    @property
    def is_sharp(self) -> bool:
        """Whether one of its terms is."""
        return any(term.is_sharp for term in self.terms)

    def value(self, n: ca.SX) -> ca.SX:
        """Separation along a unit vector (1x1) [m]."""
        return ca.dot(n, self.centre) - sum((term.reach(n, self.crown) for term in self.terms), self.ball)

    def farthest(self, n: ca.SX) -> ca.SX:
        """Point of the sum that is farthest along a unit vector (3x1) [m]."""
        return sum((term.farthest(n, self.crown) for term in self.terms), self.ball * n)

    def best(self, directions: Iterator[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Unit vector (3x1) at which the value is greatest, from where it is greatest of some directions.

        With curved terms, also from the next best: of two ways out that are nearly alike either may win.
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
        normal, lead = self.climb(first), ca.SX(0)
        if self.is_curved:
            other = self.climb(second)
            value, next_value = self.value(normal), self.value(other)
            apart = normal - other
            side = ca.if_else(ca.dot(_ASIDE, apart) < 0, -1, 1)
            lead = ca.if_else(ca.dot(apart, apart) > _APART**2, side * (value - next_value), 0)
            normal = ca.if_else(next_value > value, other, normal)
        return normal, lead

    def climb(self, n: ca.SX) -> ca.SX:
        """Unit vector (3x1) after steps towards a greater value."""
        memory = [term.first_memory() for term in self.terms]
        steps = _STEPS_SHARP if self.is_sharp else _STEPS_ROUND if self.is_curved else _STEPS
        for _ in range(steps):
            n, *memory = self._stepping(n, *memory, *self._free)
        return n

    def about(self, n: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Value around a unit vector, its slope (2x1), and the symbol (2x1) of the step across it."""
        step = ca.SX.sym("step", 2)
        value = self.value(_scaled(n + ca.mtimes(_tangents(n).T, step)))
        return value, ca.gradient(value, step), step

    @functools.cached_property
    def _free(self) -> list[ca.SX]:
        """Symbols of which all is made."""
        made = (term.made_of() for term in self.terms)
        return ca.symvar(ca.vertcat(self.centre, *made, self.ball, self.crown))

    @functools.cached_property
    def _stepping(self) -> ca.Function:
        """One step as a function, which takes less time to repeat than its expressions to build."""
        n = ca.SX.sym("n", 3)
        memory = [ca.SX.sym("memory", term.first_memory().numel()) for term in self.terms]
        # step on the sphere (3x1), and the memory of each term after it
        tangents = _tangents(n)
        pull = ca.mtimes(tangents, self.centre)
        bend = [self.ball, ca.SX(0), self.ball]  # minus the Hessian
        for term, old in zip(self.terms, memory, strict=True):
            slope, entries = term.bend(n, self.crown, tangents, old)
            pull = pull - slope
            bend = [full + entry for full, entry in zip(bend, entries, strict=True)]
        step = ca.mtimes(tangents.T, _solved(bend, self.value(n), pull))
        states = zip(self.terms, memory, strict=True)
        ahead = [term.next_memory(n, self.crown, step, old) for term, old in states]
        full = _scaled(n + step)
        if self.is_curved:  # else all of it never does harm
            worse = self.value(full) < self.value(n) - _WORSE
            shorter = _SHORTER_SHARP if self.is_sharp else _SHORTER
            full = ca.if_else(worse, _scaled(n + shorter * step), full)
        return ca.Function("step", [n, *memory, *self._free], [full, *ahead])


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
