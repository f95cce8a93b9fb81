"""Cylinder about its origin, along its z axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry
from spacerobot.shapes import CrownedTerm, Nearest, Shape, Support
from spacerobot.shapes.points import to_cylinder


@register
class Cylinder(CollisionShape):
    """Cylinder centred at its origin, along its z axis."""

    urdf_geometry: ClassVar[str | None] = "cylinder"

    kind: Literal["cylinder"] = "cylinder"
    radius: float = quantity("m", "radius", gt=0)
    length: float = quantity("m", "length along its axis", gt=0)

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """The sum of a segment along the axis and a disc across it."""
        axis = rotation[:, 2]
        return Support(
            terms=(CrownedTerm(measures[1] / 2, axis), CrownedTerm(measures[0], axis, is_disc=True))
        )

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Nearest point from its surface."""
        return to_cylinder(point, shape, shape.measures[0], shape.measures[1] / 2)

    @classmethod
    def of_urdf(cls, size: Sequence[float]) -> dict[str, Any]:
        """Radius and length."""
        return {"radius": size[0], "length": size[1]}

    def coal(self) -> Any:
        """Coal's cylinder."""
        import coal

        return coal.Cylinder(self.radius, self.length)

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """A cylinder."""
        del reach
        from spacerobot.description import Geometry

        return [DrawnGeometry(Geometry("cylinder", np.array([self.radius, self.length])))]
