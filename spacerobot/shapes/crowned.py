"""Signed distance of two convex shapes, or of a shape and a half-space, from their support functions.

The signed distance of two convex shapes is the maximum over unit vectors n of V(n) = n.c - h(n), whether they
are separated or overlap. Here c is the vector from the first centre to the second, and h(n) = h1(n) + h2(-n)
is the support function of the Minkowski difference. A fixed number of Newton steps on the unit sphere finds
the maximum. In the Hessian of a crowned term, one of the two factors u/|u| is the value predicted by the step
before (Chan, Golub and Mulet 1999), so that the steps converge even for very small crowns.

While the shapes overlap, V has several local maxima: the directions of shortest separation, called *ways
out*.
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

_STEPS, _STEPS_ROUND, _STEPS_SHARP = 12, 14, 30
"""Numbers of Newton steps: without curved terms, with curved terms, with sharp terms."""
_LONGEST = 1.0
"""Maximum length of a Newton step [rad]."""
_WORSE = 1e-12
"""Decrease of the value beyond which a step is shortened [m]; also the minimum curvature [m]."""
_SHORTER, _SHORTER_SHARP = 0.2, 0.1
"""Fraction of a step that is taken if the full step decreases the value; the same with sharp terms."""
_CURVED = 0.03
"""Minimum curvature assumed by a step while shapes overlap, relative to the depth: V has saddles there."""
_APART = 0.03
"""Distance of two unit vectors up to which they are the same way out [rad]."""
_FAR = 1e9
"""Length beyond any depth [m]."""
_ASIDE = ca.DM([0.6e-9, 0.48e-9, 0.64e-9])
"""Offset of directions that may be zero, so that they can be normalised."""


def to_plane(shape: Shape, plane: Shape, crown: ca.SX) -> Nearest:
    """Distance of a shape from a half-space, the half-space's normal, and the nearest point of its plane."""
    low = shape.position + _Reach.of(shape.position, crown, shape.support).farthest(-plane.axis)
    distance = ca.dot(plane.axis, low - plane.position)
    return distance, plane.axis, low - distance * plane.axis


def to_shape(one: Shape, other: Shape, crown: ca.SX) -> tuple[Nearest, ca.SX | None]:
    """Signed distance of two shapes.

    Separated shapes have their distance. Overlapping shapes have the shortest way out if the depth is small
    compared with the shapes, otherwise a way out that is locally the shortest.

    Returns:
        tuple: Distance, unit vector from the second to the first shape and nearest point of the second; and
            the lead (1x1) [m], the difference of V between the two best ways out, zero if there is only one,
            None without curved terms. Where the lead changes sign, normal and point jump.
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
    """Signed distance (1x1) [m] of both poses x, with the normal as a constant symbol.

    The distance is the maximum of V(x, n) over unit vectors n. Let n = (n0 + T' d) / |n0 + T' d|, where n0 is
    the maximiser, the rows of T are tangents, and M0 = -V_dd at n0. With n0 and M0 held constant, one Newton
    step

        d(x) = M0^-1 V_d(x, 0)

    gives V(x, d(x)). At the pose that belongs to n0 and M0, V_d = 0, so that its first derivative is V_x and
    its second derivative is V_xx + V_xd M0^-1 V_dx. By the implicit function theorem, both equal those of the
    distance.

    Returns:
        tuple: The distance; the symbol (6x1) of n0, first shape's axes, and of the entries 11, 12, 22 of
            M0^-1; the function that evaluates the symbol; its arguments, stacked; and the function of one
            step, as in :func:`_ascent`.
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
    """Kinds of two shapes, and the number of measures of each."""
    return (one.kind, other.kind), (one.measures.numel(), other.measures.numel())


@functools.cache
def _nearest(kinds: _Kinds, sizes: _Sizes) -> ca.Function:
    """Function for gap, normal, the second shape's nearest point and lead, in the first shape's axes."""
    inputs = _symbols(sizes)
    _, centre, *_, crown = inputs
    reach, first, others = _reach_between(kinds, inputs)
    normal, lead = reach.best(_directions(centre, first.terms, others.terms))
    nearest = centre - _Reach.of(centre, crown, others).farthest(normal)
    return ca.Function("near", inputs, ca.cse([reach.value(normal), normal, nearest, lead]))


@functools.cache
def _maximum(kinds: _Kinds, sizes: _Sizes) -> ca.Function:
    """Function of the stacked arguments for n0, first shape's axes, and the entries of M0^-1 (6x1)."""
    inputs = _symbols(sizes)
    normal = ca.SX.sym("normal", 3)
    reach, first, others = _reach_between(kinds, inputs)
    value, slope, step = reach.about(normal)
    bent = -ca.jacobian(slope, step)
    gap, bend = ca.substitute([value, ca.densify(bent)], [step], [ca.SX.zeros(2)])
    inverse = ca.Function("inverse", [*inputs, normal], [_inverse((bend[0, 0], bend[0, 1], bend[1, 1]), gap)])
    flat = ca.SX.sym("arguments", sum(one.numel() for one in inputs))
    ends = np.cumsum([0, *(one.numel() for one in inputs)])
    parts = [
        ca.reshape(flat[int(a) : int(b)], one.shape)
        for a, b, one in zip(ends[:-1], ends[1:], inputs, strict=True)
    ]
    # common subexpressions are left: interpreted, their elimination takes longer than it saves
    best = ca.Function("best", inputs, [reach.best(_directions(inputs[1], first.terms, others.terms))[0]])
    summit = best(*parts)
    name = "_".join(["maximum", *(kind.__name__.lower() for kind in kinds)])
    return ca.Function(
        name, [flat], [ca.vertcat(summit, inverse(*parts, summit))], ["arguments"], ["optimum"]
    )


@functools.cache
def _ascent(kinds: _Kinds, sizes: _Sizes) -> ca.Function | None:
    """Function of one Newton step towards the maximum; None unless a term is sharp and none has a memory.

    V(n) = n.c - h(n) is concave and homogeneous of degree one in space. If its maximum on the sphere is
    positive, that is the only local maximum with a positive value, so that steps reach it from any start.

    The function's arguments are those of :func:`_maximum` and a unit vector n (3x1), first shape's axes, or
    zeros for the direction to the second shape's centre. Its result (11x1) is the unit vector after the step;
    n and the entries of M0^-1 at n; V(n) [m]; and the norm of its gradient on the sphere [m].
    """
    inputs = _symbols(sizes)
    reach = _reach_between(kinds, inputs)[0]
    memory = [term.first_memory() for term in reach.terms]
    if not reach.is_sharp or any(one.numel() for one in memory):
        return None
    start = ca.SX.sym("n", 3)
    n = ca.if_else(ca.dot(start, start) > 0, start, _unit(reach.centre))
    normal = ca.SX.sym("normal", 3)
    value, slope, step = reach.about(normal)
    bent = -ca.jacobian(slope, step)
    at = ca.substitute([value, ca.densify(slope), ca.densify(bent)], [step], [ca.SX.zeros(2)])
    inverse = _inverse((at[2][0, 0], at[2][0, 1], at[2][1, 1]), at[0])
    optimum = ca.vertcat(normal, inverse, at[0], ca.norm_2(at[1]))
    at_start = ca.Function("at_start", [*inputs, normal], [optimum])(*inputs, n)
    flat = ca.vertcat(*(ca.vec(one) for one in inputs))
    after_step = reach._stepping(n, *memory, *reach._free)[0]
    result = ca.vertcat(after_step, at_start)
    name = "_".join(["ascent", *(kind.__name__.lower() for kind in kinds)])
    return ca.Function(name, [flat, start], [ca.densify(ca.cse(result))])


def _symbols(sizes: _Sizes) -> list[ca.SX]:
    """Rotation and centre of the second shape in the first's axes, measures of each, and the crown."""
    measures = [ca.SX.sym("measures", size) for size in sizes]
    return [ca.SX.sym("turn", 3, 3), ca.SX.sym("centre", 3), *measures, ca.SX.sym("crown")]


def _reach_between(kinds: _Kinds, inputs: Sequence[ca.SX]) -> tuple[_Reach, Support, Support]:
    """V of two shapes in the first's axes, h1(n) of the first and h2(-n) of the second."""
    turn, centre, *measures, crown = inputs
    first = kinds[0].support(ca.SX.eye(3), measures[0])
    others = kinds[1].support(turn, measures[1]).reflected()
    return _Reach.of(centre, crown, first, others), first, others


def _directions(centre: ca.SX, first: Sequence[Term], others: Sequence[Term]) -> Iterator[ca.SX]:
    """First guesses (3x1) of the maximiser: axes, cross products of two axes (edge to edge), radial ones."""
    axes = [[axis for term in terms for axis in term.axes()] for terms in (first, others)]
    yield from (*axes[0], *axes[1])
    yield from (cross(a, b) for a, b in itertools.product(*axes))
    yield from (direction for term in (*first, *others) for direction in term.radial(centre))


@dataclass(frozen=True)
class _Reach:
    """Function V(n) = n.c - h(n) [m] of a centre c (3x1) [m] and a sum h of support functions."""

    centre: ca.SX
    terms: tuple[Term, ...]
    ball: ca.SX
    crown: ca.SX

    @classmethod
    def of(cls, centre: ca.SX, crown: ca.SX, *supports: Support) -> _Reach:
        """V of a centre and the Minkowski sum of some shapes, by their support functions."""
        terms = tuple(term for support in supports for term in support.terms)
        return cls(centre, terms, sum((support.ball for support in supports), ca.SX(0)), crown)

    @property
    def is_curved(self) -> bool:
        """Whether a term is curved, so that the maximiser may be any direction."""
        return any(term.is_curved for term in self.terms)

    @property
    def is_sharp(self) -> bool:
        """Whether a term is sharp, so that more and shorter steps are needed."""
        return any(term.is_sharp for term in self.terms)

    def value(self, n: ca.SX) -> ca.SX:
        """Separation V(n) along a unit vector (1x1) [m]."""
        return ca.dot(n, self.centre) - sum((term.reach(n, self.crown) for term in self.terms), self.ball)

    def farthest(self, n: ca.SX) -> ca.SX:
        """Support point: the point of the Minkowski sum that is farthest along a unit vector (3x1) [m]."""
        return sum((term.farthest(n, self.crown) for term in self.terms), self.ball * n)

    def best(self, directions: Iterator[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Maximiser of V (3x1), by Newton steps from the best of some directions.

        With curved terms, steps also start from the second best direction, since either of two similar ways
        out may be the shorter one.

        Returns:
            tuple: The unit vector, and the lead (1x1) [m]: the difference of V between the two ways out. Its
                sign follows a fixed direction, not the order of the search, so that it is continuous.
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
        """Unit vector (3x1) after a fixed number of Newton steps."""
        memory = [term.first_memory() for term in self.terms]
        steps = _STEPS_SHARP if self.is_sharp else _STEPS_ROUND if self.is_curved else _STEPS
        for _ in range(steps):
            n, *memory = self._stepping(n, *memory, *self._free)
        return n

    def about(self, n: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """V around a unit vector (1x1) [m], its gradient (2x1), and the symbol (2x1) of a tangential step."""
        step = ca.SX.sym("step", 2)
        value = self.value(_scaled(n + ca.mtimes(_tangents(n).T, step)))
        return value, ca.gradient(value, step), step

    @functools.cached_property
    def _free(self) -> list[ca.SX]:
        """Symbols that the expressions of V depend on."""
        term_symbols = (term.made_of() for term in self.terms)
        return ca.symvar(ca.vertcat(self.centre, *term_symbols, self.ball, self.crown))

    @functools.cached_property
    def _stepping(self) -> ca.Function:
        """Function of one Newton step, whose repeated call is faster than to build its expressions again."""
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
        if self.is_curved:  # without curved terms, a full step never decreases V
            worse = self.value(full) < self.value(n) - _WORSE
            shorter = _SHORTER_SHARP if self.is_sharp else _SHORTER
            full = ca.if_else(worse, _scaled(n + shorter * step), full)
        return ca.Function("step", [n, *memory, *self._free], [full, *ahead])


def _solved(bend: Sequence[ca.SX], value: ca.SX, pull: ca.SX) -> ca.SX:
    """Newton step in the tangent plane (2x1).

    On the unit sphere, the Hessian of V is its tangential part V_tt in space minus (n . grad V) I. V is
    homogeneous of degree one, so that n . grad V = V (Euler). Minus the Hessian is therefore bend + V I.
    While shapes overlap (V < 0) it may be indefinite, and is shifted to a smallest eigenvalue of _CURVED |V|.
    """
    middle, half = (bend[0] + bend[2]) / 2, (bend[0] - bend[2]) / 2
    least = middle - ca.sqrt(half**2 + bend[1] ** 2 + TINY)
    add = ca.if_else(value > 0, value, ca.fmax(value, -least - _CURVED * value)) + _WORSE
    a, b, c = bend[0] + add, bend[1], bend[2] + add
    step = ca.vertcat(c * pull[0] - b * pull[1], a * pull[1] - b * pull[0]) / (a * c - b**2)
    return step * ca.fmin(1, _LONGEST / ca.sqrt(ca.dot(step, step) + TINY))


def _inverse(bend: Sequence[ca.SX], value: ca.SX) -> ca.SX:
    """Entries 11, 12, 22 (3x1) of the inverse of minus a Hessian, shifted as in :func:`_solved`."""
    middle, half = (bend[0] + bend[2]) / 2, (bend[0] - bend[2]) / 2
    least = middle - ca.sqrt(half**2 + bend[1] ** 2 + TINY)
    add = ca.if_else(value > 0, 0, ca.fmax(0, -least - _CURVED * value)) + _WORSE
    a, b, c = bend[0] + add, bend[1], bend[2] + add
    return ca.vertcat(c, -b, a) / (a * c - b**2)


def _tangents(n: ca.SX) -> ca.SX:
    """Two unit vectors, as rows (2x3), orthogonal to a unit vector and to each other (Duff et al. 2017)."""
    side = ca.if_else(n[2] < 0, -1, 1)
    a = -1 / (side + n[2])
    b = n[0] * n[1] * a
    rows = (1 + side * a * n[0] ** 2, side * b, -side * n[0]), (b, side + a * n[1] ** 2, -n[1])
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _unit(direction: ca.SX) -> ca.SX:
    """Unit vector (3x1) along a direction that may be zero."""
    return _scaled(direction + _ASIDE)


def _scaled(direction: ca.SX) -> ca.SX:
    """Unit vector along a direction (3x1)."""
    return direction / ca.sqrt(ca.dot(direction, direction))
