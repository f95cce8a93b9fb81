"""Box about its origin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.section import Vector, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry, Wrapping
from spacerobot.shapes import CrownedTerm, Nearest, Shape, Support
from spacerobot.shapes.points import to_box


@register
class Box(CollisionShape):
    """Box centred at its origin, with edges along its axes."""

    urdf_geometry: ClassVar[str | None] = "box"
    wrap_order: ClassVar[int | None] = 2

    kind: Literal["box"] = "box"
    size: Vector = quantity("m", "edges along x, y, z")

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """The sum of three segments."""
        half = measures / 2
        return Support(terms=tuple(CrownedTerm(half[i], rotation[:, i]) for i in range(3)))

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Nearest point from its surface."""
        return to_box(point, shape, shape.measures / 2)

    @classmethod
    def of_urdf(cls, size: Sequence[float]) -> dict[str, Any]:
        """Section of a box from the edge lengths of a URDF [m]."""
        return {"size": tuple(size)}

    @classmethod
    def around(cls, points: Array, axes: Sequence[int]) -> Wrapping:
        """The points' extents along their axes."""
        import pinocchio as pin  # not needed to validate a section

        del axes
        low, high = points.min(axis=0), points.max(axis=0)
        size = tuple(2 * float(half) for half in (high - low) / 2)
        return Wrapping({"size": size}, pin.SE3(np.eye(3), (low + high) / 2).homogeneous)

    def coal(self) -> Any:
        """Coal's box."""
        import coal

        return coal.Box(*self.size)

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """A box."""
        del reach
        from spacerobot.description import Geometry

        return [DrawnGeometry(Geometry("box", np.array(self.size)))]
