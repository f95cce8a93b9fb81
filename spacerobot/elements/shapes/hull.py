"""Convex hull of points, with domed faces."""

from __future__ import annotations

from typing import Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import Vector
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry
from spacerobot.shapes import SmoothTerm, Support

POWER = 32
"""Exponent of the norm that replaces the maximum over the points. A face of m points is domed by m^(1/32) - 1
of its distance from the origin, 4.4 % for a quadrilateral."""


def support_law(n: ca.SX, measures: ca.SX) -> ca.SX:
    """Support function (1x1) [m]: (sum of max(x.n, 0)^p)^(1/p) over the points x, at least their maximum.

    It is convex and twice differentiable. The largest x.n is factored out to avoid overflow.
    """
    along = ca.fmax(ca.mtimes(ca.reshape(measures, 3, measures.numel() // 3).T, n), 0)
    largest = ca.norm_2(along)
    return largest * ca.sum1((along / largest) ** POWER) ** (1 / POWER)


@register
class Hull(CollisionShape):
    """Convex hull of points, its faces domed by some per cent of their distance from the origin.

    The origin is inside. All points are inside the shape or on it, so that distances are never too large.
    """

    kind: Literal["hull"] = "hull"
    points: tuple[Vector, ...] = Field(
        min_length=4, description="corners [m], own axes, around the own origin"
    )

    @model_validator(mode="after")
    def _check_measures(self) -> Hull:
        from scipy.spatial import ConvexHull, QhullError

        try:
            planes = ConvexHull(np.array(self.points)).equations
        except QhullError:
            raise ValueError("points: found points of one plane, allowed: corners of a body") from None
        if planes[:, 3].max() >= 0:
            raise ValueError("points: the origin is outside their hull; move it inside by `position`")
        return self

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Support function with one smooth term."""
        return Support(terms=(SmoothTerm(support_law, rotation, measures, is_sharp=True),))

    def measures(self, context: SectionContext | None = None) -> ca.SX:
        """Coordinates of the corners (3 n x 1) [m], corner by corner."""
        if context is None:
            return ca.SX(ca.DM(np.array(self.points).ravel()))
        numbers = (context.number(f"points.{i}.{k}") for i in range(len(self.points)) for k in range(3))
        return ca.vertcat(*numbers)

    def surface_points(self) -> Array:
        """The corners, and points of the domed faces (n, 3) [m]."""
        return np.vstack([np.array(self.points), super().surface_points()])

    def words(self) -> str:
        """Kind and number of corners, in text form."""
        return f"{self.kind}, {len(self.points)} points"

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """The hull of the corners."""
        del reach
        from spacerobot.description import Geometry

        return [DrawnGeometry(Geometry("mesh", np.ones(3), corners=np.array(self.points)))]
