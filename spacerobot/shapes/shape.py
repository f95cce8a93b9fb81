"""A convex primitive somewhere in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca

ShapeKind = Literal["sphere", "capsule", "cylinder", "box", "plane"]


@dataclass(frozen=True)
class Shape:
    """A convex primitive, world axes.

    A sphere is its centre and a capsule the segment along its own z axis, each with a radius around it. A
    plane is the half-space below its own x-y plane.

    Attributes
    ----------
    rotation, position
        Of its own frame (3x3, 3x1) [m].
    radius
        Of a sphere, capsule or cylinder (1x1) [m]; zero of the others.
    half
        Half the length of a capsule's segment or of a cylinder (1x1), half the edges of a box (3x1) [m];
        empty for the others.
    """

    rotation: ca.SX
    position: ca.SX
    radius: ca.SX
    half: ca.SX

    @property
    def axis(self) -> ca.SX:
        """Own z axis (3x1)."""
        return self.rotation[:, 2]

    def inside(self, point: ca.SX) -> ca.SX:
        """A point (3x1) [m] in own axes."""
        return ca.mtimes(self.rotation.T, point - self.position)

    def outside(self, direction: ca.SX) -> ca.SX:
        """A direction (3x1) given in own axes."""
        return ca.mtimes(self.rotation, direction)
