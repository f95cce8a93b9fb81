"""Half-space below a plane."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.elements.core.registry import register
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry
from spacerobot.shapes import Nearest, Shape, Support
from spacerobot.shapes.points import to_plane

_TRANSLUCENT = 0.3


@register
class Plane(CollisionShape):
    """Half-space below its own x-y plane."""

    is_halfspace: ClassVar[bool] = True

    kind: Literal["plane"] = "plane"

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Empty support: a half-space is unbounded."""
        del rotation, measures
        return Support()

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Nearest point from the plane."""
        return to_plane(point, shape)

    def coal(self) -> Any:
        """Coal's half-space."""
        import coal

        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """Plate with a pin along its normal, wide enough for the touching shapes."""
        from spacerobot.description import Geometry

        edge, length = 3 * reach, 0.4 * reach
        plate = Geometry("box", np.array([edge, edge, 0.01 * edge]))
        stick = Geometry("cylinder", np.array([0.012 * reach, length]))
        head = Geometry("sphere", np.array([0.03 * reach]))
        return [
            DrawnGeometry(plate, -0.005 * edge, _TRANSLUCENT),
            DrawnGeometry(stick, length / 2),
            DrawnGeometry(head, length),
        ]
