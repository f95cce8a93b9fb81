"""Convex shape in the world, and the protocol of its kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca

from spacerobot.shapes.support import Support

Nearest = tuple[ca.SX, ca.SX, ca.SX]
"""Distance (1x1) [m], unit vector from the core to the point (3x1), nearest point of the core (3x1) [m]."""


class ConvexKind(Protocol):
    """A kind of convex shape: its geometry as expressions of its measures."""

    is_halfspace: ClassVar[bool]

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Support function of a shape with a rotation (3x3) and measures (n x 1) [m]."""

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Distance from a point (3x1) [m] to the shape without its ball; None without a closed form."""


@dataclass(frozen=True)
class Shape:
    """A convex shape, world axes.

    Attributes:
        kind: Kind of the shape. A half-space is everything below the x-y plane of its frame.
        rotation, position: Pose of the shape's frame in the world (3x3, 3x1) [m].
        measures: Lengths (n x 1) [m] in the order of the kind, such as a radius.
    """

    kind: type[ConvexKind]
    rotation: ca.SX
    position: ca.SX
    measures: ca.SX

    @property
    def axis(self) -> ca.SX:
        """Z axis of the shape's frame, world axes (3x1)."""
        return self.rotation[:, 2]

    @property
    def support(self) -> Support:
        """Support function about the shape's origin."""
        return self.kind.support(self.rotation, self.measures)

    @property
    def is_ball(self) -> bool:
        """Whether the shape is a ball, without other terms."""
        return not (self.kind.is_halfspace or self.support.terms)

    def inside(self, point: ca.SX) -> ca.SX:
        """Coordinates (3x1) [m] of a world point in the shape's frame."""
        return ca.mtimes(self.rotation.T, point - self.position)

    def outside(self, direction: ca.SX) -> ca.SX:
        """World components (3x1) of a direction in the shape's axes."""
        return ca.mtimes(self.rotation, direction)
