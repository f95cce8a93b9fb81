"""A convex shape in the world, and the protocol of its kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca

from spacerobot.shapes.support import Support

Nearest = tuple[ca.SX, ca.SX, ca.SX]
"""Distance (1x1) [m], unit direction (3x1), nearest point of the core (3x1) [m]."""


class ConvexKind(Protocol):
    """A kind of convex shape: its geometry as expressions of its measures."""

    is_halfspace: ClassVar[bool]

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Support function of the shape turned by a rotation (3x3), of its measures (n x 1) [m]."""

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """From a point (3x1) [m] to the shape without its ball; None without a closed form."""


@dataclass(frozen=True)
class Shape:
    """A convex shape, world axes.

    Attributes:
        kind: Which one; a half-space is all that is below its own x-y plane.
        rotation, position: Of its own frame (3x3, 3x1) [m].
        measures: Its lengths (n x 1) [m], in the order of its kind.
    """

    kind: type[ConvexKind]
    rotation: ca.SX
    position: ca.SX
    measures: ca.SX

    @property
    def axis(self) -> ca.SX:
        """Own z axis (3x1)."""
        return self.rotation[:, 2]

    @property
    def support(self) -> Support:
        """Its support function about its origin."""
        return self.kind.support(self.rotation, self.measures)

    @property
    def is_ball(self) -> bool:
        """Whether it is a ball and nothing else."""
        return not (self.kind.is_halfspace or self.support.terms)

    def inside(self, point: ca.SX) -> ca.SX:
        """A point (3x1) [m] in own axes."""
        return ca.mtimes(self.rotation.T, point - self.position)

    def outside(self, direction: ca.SX) -> ca.SX:
        """A direction (3x1) given in own axes."""
        return ca.mtimes(self.rotation, direction)
