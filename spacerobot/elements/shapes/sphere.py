"""Sphere about its origin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry, Wrapping
from spacerobot.shapes import Nearest, Shape, Support
from spacerobot.shapes.points import to_point


@register
class Sphere(CollisionShape):
    """Sphere about its origin."""

    urdf_geometry: ClassVar[str | None] = "sphere"
    wrap_order: ClassVar[int | None] = 3

    kind: Literal["sphere"] = "sphere"
    radius: float = quantity("m", "radius", gt=0)

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """A ball."""
        del rotation
        return Support(ball=measures[0])

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Nearest point from its centre."""
        return to_point(point, shape.position)

    @classmethod
    def of_urdf(cls, size: Sequence[float]) -> dict[str, Any]:
        """Radius from the URDF's size [m]."""
        return {"radius": size[0]}

    @classmethod
    def around(cls, points: Array, axes: Sequence[int]) -> Wrapping:
        """About the middle of the points' extents."""
        import pinocchio as pin  # not needed to validate a section

        del axes
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = float(np.linalg.norm(points - middle, axis=1).max())
        return Wrapping({"radius": radius}, pin.SE3(np.eye(3), middle).homogeneous)

    def coal(self) -> Any:
        """Coal's sphere."""
        import coal

        return coal.Sphere(self.radius)

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """A sphere."""
        del reach
        from spacerobot.description import Geometry

        return [DrawnGeometry(Geometry("sphere", np.array([self.radius])))]
