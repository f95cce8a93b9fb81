"""Support functions of convex shapes: how far a shape reaches along a direction.

A shape is a Minkowski sum of a ball and terms, so its support function h(n) is the sum of theirs. A segment's
or disc's term is ``size |u|``, where u is the part of n along the segment's axis, or across the disc's. It
has a kink where u = 0: there a whole edge or face is farthest. Crowned, it is ``size sqrt(|u|^2 + crown^2)``,
which domes edges and faces by ``crown size`` and makes the farthest point unique. A smooth term is any
function that has two derivatives and is homogeneous of degree one, as that of an ellipsoid.
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
"""Support function (1x1) [m] of a direction in own axes (3x1) and measures (n x 1) [m]."""


class Term(Protocol):
    """A term of a support function; n is a unit vector (3x1), world axes.

    ``memory`` is what the term keeps between the Newton steps of :mod:`spacerobot.shapes.crowned`.
    """

    @property
    def is_sharp(self) -> bool:
        """Whether the search for the direction needs more and shorter steps."""

    @property
    def is_curved(self) -> bool:
        """Whether directions that maximise a distance may lie anywhere, not only at axes and across two."""

    def reach(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Its value (1x1) [m]."""

    def farthest(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Its gradient (3x1) [m]: the farthest point."""

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient (2x1) and Hessian (its entries 00, 01, 11) along two tangents (2x3) [m]."""

    def first_memory(self) -> ca.SX:
        """The memory before the first step."""

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """The memory after a step (3x1) from a direction."""

    def axes(self) -> Sequence[ca.SX]:
        """Directions (3x1) of flat faces or of greatest and least reach."""

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """Directions (3x1) towards a point (3x1) [m] that its shape singles out."""

    def made_of(self) -> ca.SX:
        """Expressions (n x 1) of which it is made."""

    def reflected(self) -> Term:
        """The term reflected at its origin: its value at -n."""


@dataclass(frozen=True)
class CrownedTerm:
    """A segment along an axis (3x1), or a disc across it, of half length or radius ``size`` (1x1) [m]."""

    size: ca.SX
    axis: ca.SX
    is_disc: bool = False
    is_sharp: ClassVar[bool] = False

    @property
    def is_curved(self) -> bool:
        """A disc is."""
        return self.is_disc

    def seen(self, n: ca.SX) -> ca.SX:
        """The part u of a direction (3x1) along the segment's axis, or across the disc's."""
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
        scaled = self.seen(n)
        length = ca.sqrt(ca.dot(scaled, scaled) + crown**2)
        return self.size * (scaled + crown**2 * n) / length

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient and Hessian along two tangents, one of the factors u/|u| being that of the memory.

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
        # u along the tangents, now and as it was foreseen, the latter over its length
        now, sign = (-along if self.is_disc else along) * across, -1 if self.is_disc else 1
        before = ca.mtimes(tangents, memory) if self.is_disc else memory * across
        entries = []
        for i, j in ((0, 0), (0, 1), (1, 1)):
            flat = (now[i] * before[j] + now[j] * before[i]) / (2 * length)
            curved = (i == j) * (crown**2 + self.is_disc) + sign * across[i] * across[j] - flat
            entries.append(self.size / length * curved)
        return self.size / length * now, tuple(entries)

    def first_memory(self) -> ca.SX:
        """No direction: along a segment (1x1), across a disc (3x1)."""
        return ca.SX.zeros(3 if self.is_disc else 1)

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """Predicted u over its length after a step, within the unit ball.

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
        new = (self.seen(n) + self.seen(step) + memory * along * further / length) / length
        return new / ca.fmax(1, ca.sqrt(ca.dot(new, new) + TINY))

    def axes(self) -> Sequence[ca.SX]:
        """A segment's."""
        return () if self.is_disc else (self.axis,)

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """Across a disc's axis."""
        return (self.seen(centre),) if self.is_disc else ()

    def made_of(self) -> ca.SX:
        """Axis and size."""
        return ca.vertcat(self.axis, self.size)

    def reflected(self) -> CrownedTerm:
        """Itself: segments and discs are symmetric."""
        return self


@dataclass(frozen=True)
class SmoothTerm:
    """A support function without kinks, by its law in own axes.

    Attributes:
        law: Support function; its derivatives are CasADi's.
        rotation: From own to world axes (3x3).
        measures: Of the shape (n x 1) [m].
        is_sharp: Whether its curvature changes much within small angles, as that of rounded corners does, so
            that more and shorter steps are needed.
    """

    law: SupportLaw
    rotation: ca.SX
    measures: ca.SX
    is_sharp: bool = False
    is_curved: ClassVar[bool] = True

    @property
    def own_derivatives(self) -> ca.Function:
        """Direction and measures to value (1x1), gradient (3x1) and Hessian (3x3) [m], all in own axes."""
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
            crown: Of no effect.
        """
        del crown
        return self.derivatives(n)[0]

    def farthest(self, n: ca.SX, crown: ca.SX) -> ca.SX:
        """Farthest point along a unit vector: the gradient of the support function (3x1) [m].

        Args:
            n: Unit vector, world axes (3x1).
            crown: Of no effect.
        """
        del crown
        return self.derivatives(n)[1]

    def bend(self, n: ca.SX, crown: ca.SX, tangents: ca.SX, memory: ca.SX) -> tuple[ca.SX, tuple[ca.SX, ...]]:
        """Gradient and Hessian along two tangents.

        Args:
            n: Unit vector, world axes (3x1).
            crown, memory: Of no effect.
            tangents: Two tangents to the unit sphere at n, as rows (2x3).

        Returns:
            tuple: Gradient (2x1) and the Hessian's entries 00, 01, 11 (1x1 each) [m].
        """
        del crown, memory
        _, gradient, hessian = self.derivatives(n)
        along = ca.mtimes([tangents, hessian, tangents.T])
        return ca.mtimes(tangents, gradient), (along[0, 0], along[0, 1], along[1, 1])

    def first_memory(self) -> ca.SX:
        """Nothing."""
        return ca.SX(0, 1)

    def next_memory(self, n: ca.SX, crown: ca.SX, step: ca.SX, memory: ca.SX) -> ca.SX:
        """Memory after a step, which is empty.

        Args:
            n, crown, step: Of no effect.
            memory: Empty memory (0x1), returned as it is.
        """
        del n, crown, step
        return memory

    def axes(self) -> Sequence[ca.SX]:
        """Its own axes."""
        return tuple(self.rotation[:, i] for i in range(3))

    def radial(self, centre: ca.SX) -> Sequence[ca.SX]:
        """None."""
        del centre
        return ()

    def made_of(self) -> ca.SX:
        """Rotation and measures."""
        return ca.vertcat(ca.vec(self.rotation), self.measures)

    def reflected(self) -> SmoothTerm:
        """Its law with all axes reversed."""
        return dataclasses.replace(self, rotation=-self.rotation)


@functools.cache
def _derivatives(law: SupportLaw, size: int) -> ca.Function:
    """Value, gradient and Hessian of a law with so many measures."""
    n, measures = ca.SX.sym("n", 3), ca.SX.sym("measures", size)
    value = law(n, measures)
    hessian, gradient = ca.hessian(value, n)
    return ca.Function("support", [n, measures], [value, gradient, hessian])


@dataclass(frozen=True)
class Support:
    """Support function of a shape about its origin, world axes.

    Attributes:
        ball: Radius of its ball (1x1) [m].
        terms: What is added to the ball.
    """

    ball: ca.SX = ca.SX(0)  # noqa: RUF009 (never changed)
    terms: tuple[Term, ...] = ()

    def reflected(self) -> Support:
        """Support function of the shape reflected at its origin."""
        return Support(self.ball, tuple(term.reflected() for term in self.terms))
