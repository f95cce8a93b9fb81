"""Support functions h(n) of convex shapes: the maximum of n.p over the points p of a shape.

A shape is the Minkowski sum of a ball and terms, so that its support function is the sum of theirs. The term
of a segment or disc is ``size |u|``, where u is the component of n along the segment's axis or perpendicular
to the disc's. It has a kink at u = 0, where every point of an edge or face is farthest. The crowned term
``size sqrt(|u|^2 + crown^2)`` adds a dome of height ``crown size`` to edges and faces, so that the farthest
point is unique. A smooth term is any twice differentiable function that is homogeneous of degree one, such as
that of an ellipsoid.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca

from spacerobot.shapes.clamp import TINY, clamp

SupportLaw = Callable[[ca.SX, ca.SX], ca.SX]
"""Support function (1x1) [m] of a direction in the shape's axes (3x1) and measures (n x 1) [m]."""


class Term(Protocol):
    """A term of a support function; n is a unit vector (3x1), world axes.

    ``memory`` is a state that the term carries from one Newton step of :mod:`spacerobot.shapes.crowned` to
    the next.
    """

    @property
    def is_sharp(self) -> bool:
        """Whether the curvature changes so fast that the search needs more and shorter steps."""

    @property
    def is_curved(self) -> bool:
        """Whether the normal of a pair may be any direction, not only an axis or a product of two axes."""

    def reach(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Value of the term (1x1) [m]."""

    def farthest(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Gradient of the term (3x1) [m], which is the farthest point."""

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient (2x1) and Hessian (its entries 00, 01, 11) along two tangents (2x3) [m]."""

    def first_memory(self) -> ca.SX:
        """Memory before the first step."""

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """Memory after a step (3x1) from a direction."""

    def axes(self) -> Sequence[ca.SX]:
        """Directions (3x1) of the shape's axes, first guesses of a pair's normal."""

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """Further first guesses (3x1), which depend on the other shape's centre (3x1) [m]."""

    def made_of(self) -> ca.SX:
        """Expressions that the term depends on (n x 1)."""

    def reflected(self) -> Term:
        """The term reflected at the origin, whose value at n is that at -n."""


@dataclass(frozen=True)
class CrownedTerm:
    """Crowned term of a segment along an axis, or of a disc perpendicular to it.

    Attributes:
        size: Half length of the segment or radius of the disc (1x1) [m].
        axis: Unit vector of the axis (3x1), world axes.
        is_disc: Whether the term is a disc.
    """

    size: ca.SX
    axis: ca.SX
    is_disc: bool = False
    is_sharp: ClassVar[bool] = False

    @property
    def is_curved(self) -> bool:
        """Whether the term is a disc."""
        return self.is_disc

    def component(self, n: ca.SX) -> ca.SX:
        """Component u of a direction (3x1) along the segment's axis, or perpendicular to the disc's."""
        along = ca.dot(self.axis, n) * self.axis
        return n - along if self.is_disc else along

    def square(self, n: ca.SX) -> ca.SX:
        """|u|^2 of a unit vector (1x1)."""
        along = ca.dot(self.axis, n)
        return ca.fmax(1 - along**2, 0) if self.is_disc else along**2

    def length(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Crowned length ``sqrt(|u|^2 + crown^2)`` (1x1).

        Args:
            n: Unit vector, world axes (3x1).
            crown: Crown of flat faces and straight edges (1x1).
        """
        return ca.sqrt(self.square(n) + crown**2)

    def reach(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Support function: size times the crowned length (1x1) [m].

        Args:
            n: Unit vector, world axes (3x1).
            crown: Crown of flat faces and straight edges (1x1).
        """
        return self.size * self.length(n, crown)

    def farthest(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Farthest point along a unit vector, world axes (3x1) [m].

        Args:
            n: Unit vector, world axes (3x1).
            crown: Crown of flat faces and straight edges (1x1).
        """
        scaled = self.component(n)
        length = ca.sqrt(ca.dot(scaled, scaled) + crown**2)
        return self.size * (scaled + crown**2 * n) / length

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient and approximate Hessian along two tangents.

        With L = sqrt(q), q = n' (P + crown^2 I) n, P = a a' (segment) or I - a a' (disc) and a tangent
        component t of u = P n, the gradient is ``size t / L`` and the Hessian is
        ``size / L (P_tt + crown^2 I - t t' / L^2)``. In t t' / L^2, one factor t / L is replaced by that of
        the memory, symmetrised, which keeps Newton's method convergent where u is small (Chan, Golub and
        Mulet 1999).

        Args:
            n: Unit vector, world axes (3x1).
            crown: Crown of flat faces and straight edges (1x1).
            tangents: Two tangents to the unit sphere at n, as rows (2x3).
            memory: Memory of the preceding Newton step.

        Returns:
            tuple: Gradient (2x1) and the Hessian's entries 00, 01, 11 (1x1 each) [m].
        """
        along, across = ca.dot(self.axis, n), ca.mtimes(tangents, self.axis)
        length = self.length(n, crown)
        # tangential components of u at n, and of u / L as the step before predicted it
        now, sign = (-along if self.is_disc else along) * across, -1 if self.is_disc else 1
        before = ca.mtimes(tangents, memory) if self.is_disc else memory * across
        entries = []
        for i, j in ((0, 0), (0, 1), (1, 1)):
            flat = (now[i] * before[j] + now[j] * before[i]) / (2 * length)
            curved = (i == j) * (crown**2 + self.is_disc) + sign * across[i] * across[j] - flat
            entries.append(self.size / length * curved)
        return self.size / length * now, tuple(entries)

    def first_memory(self) -> ca.SX:
        """Zero: along a segment's axis (1x1), or in a disc's plane (3x1)."""
        return ca.SX.zeros(3 if self.is_disc else 1)

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """Predicted w = u / L after a step, limited to the unit ball.

        The linearisation of L w = u is ``w+ = (u + du - w dL) / L`` with dL = u.du / L. For a segment, w is a
        number along the axis. For a disc, u.du = -(a.n)(a.step), since n.step = 0.

        Args:
            n: Unit vector, world axes (3x1).
            crown: Crown of flat faces and straight edges (1x1).
            step: Change of n (3x1).
            memory: Memory of the preceding Newton step.
        """
        length = self.length(n, crown)
        along, further = ca.dot(self.axis, n), ca.dot(self.axis, step)
        if not self.is_disc:
            return clamp((along + further - memory * along * further / length) / length, ca.SX(1))
        new = (self.component(n) + self.component(step) + memory * along * further / length) / length
        return new / ca.fmax(1, ca.sqrt(ca.dot(new, new) + TINY))

    def axes(self) -> Sequence[ca.SX]:
        """Axis of a segment; none for a disc."""
        return () if self.is_disc else (self.axis,)

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """Component of the centre in a disc's plane; none for a segment."""
        return (self.component(centre),) if self.is_disc else ()

    def made_of(self) -> ca.SX:
        """Axis and size (4x1)."""
        return ca.vertcat(self.axis, self.size)

    def reflected(self) -> CrownedTerm:
        """The term itself: segments and discs are symmetric."""
        return self


@dataclass(frozen=True)
class SmoothTerm:
    """A twice differentiable term, defined by its support function in the shape's axes.

    Attributes:
        law: Support function, which CasADi differentiates.
        rotation: Rotation from the shape's to world axes (3x3).
        measures: Measures of the shape (n x 1) [m].
        is_sharp: Whether the curvature changes much within small angles, as at rounded corners, so that more
            and shorter steps are needed.
    """

    law: SupportLaw
    rotation: ca.SX
    measures: ca.SX
    is_sharp: bool = False
    is_curved: ClassVar[bool] = True

    @property
    def own_derivatives(self) -> ca.Function:
        """Function of direction and measures for value, gradient and Hessian [m], in the shape's axes."""
        return _derivatives(self.law, self.measures.numel())

    def derivatives(self, n: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Value (1x1), gradient (3x1) and Hessian (3x3) at a direction (3x1) [m], world axes."""
        value, gradient, hessian = self.own_derivatives(ca.mtimes(self.rotation.T, n), self.measures)
        turned = ca.mtimes([self.rotation, hessian, self.rotation.T])
        return value, ca.mtimes(self.rotation, gradient), turned

    def reach(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Support function (1x1) [m].

        Args:
            n: Unit vector, world axes (3x1).
            crown: Not used.
        """
        del crown
        return self.derivatives(n)[0]

    def farthest(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Farthest point along a unit vector: the gradient of the support function (3x1) [m].

        Args:
            n: Unit vector, world axes (3x1).
            crown: Not used.
        """
        del crown
        return self.derivatives(n)[1]

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient and Hessian along two tangents.

        Args:
            n: Unit vector, world axes (3x1).
            crown, memory: Not used.
            tangents: Two tangents to the unit sphere at n, as rows (2x3).

        Returns:
            tuple: Gradient (2x1) and the Hessian's entries 00, 01, 11 (1x1 each) [m].
        """
        del crown, memory
        _, gradient, hessian = self.derivatives(n)
        along = ca.mtimes([tangents, hessian, tangents.T])
        return ca.mtimes(tangents, gradient), (along[0, 0], along[0, 1], along[1, 1])

    def first_memory(self) -> ca.SX:
        """Empty memory (0x1)."""
        return ca.SX(0, 1)

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """Memory after a step, which is empty.

        Args:
            n, crown, step: Not used.
            memory: Empty memory (0x1), returned as it is.
        """
        del n, crown, step
        return memory

    def axes(self) -> Sequence[ca.SX]:
        """Axes of the shape's frame."""
        return tuple(self.rotation[:, i] for i in range(3))

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """No further first guesses."""
        del centre
        return ()

    def made_of(self) -> ca.SX:
        """Rotation and measures (9 + n x 1)."""
        return ca.vertcat(ca.vec(self.rotation), self.measures)

    def reflected(self) -> SmoothTerm:
        """The term with all axes reversed."""
        return dataclasses.replace(self, rotation=-self.rotation)


@functools.cache
def _derivatives(law: SupportLaw, size: int) -> ca.Function:
    """Function of value, gradient and Hessian of a law with a number of measures."""
    n, measures = ca.SX.sym("n", 3), ca.SX.sym("measures", size)
    value = law(n, measures)
    hessian, gradient = ca.hessian(value, n)
    return ca.Function("support", [n, measures], [value, gradient, hessian])


@dataclass(frozen=True)
class Support:
    """Support function of a shape about its origin, world axes.

    Attributes:
        ball: Radius of its ball (1x1) [m].
        terms: Terms of the Minkowski sum besides the ball.
    """

    ball: ca.SX = ca.SX(0)  # noqa: RUF009 (never changed)
    terms: tuple[Term, ...] = ()

    def reflected(self) -> Support:
        """Support function of the shape reflected at its origin."""
        return Support(self.ball, tuple(term.reflected() for term in self.terms))
