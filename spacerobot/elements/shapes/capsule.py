"""Capsule about its origin, along its z axis: a cylinder with half balls on its ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.section import quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.shapes.collision_shape import CollisionShape, DrawnGeometry, Wrapping
from spacerobot.shapes import CrownedTerm, Nearest, Shape, Support
from spacerobot.shapes.points import to_segment


@register
class Capsule(CollisionShape):
    """Capsule centred at its origin along its z axis: a cylinder with hemispherical ends."""

    wrap_order: ClassVar[int | None] = 1

    kind: Literal["capsule"] = "capsule"
    radius: float = quantity("m", "radius", gt=0)
    length: float = quantity("m", "length between the centres of its ends", gt=0)

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """The sum of a segment along the axis and a ball."""
        return Support(measures[0], (CrownedTerm(measures[1] / 2, rotation[:, 2]),))

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Nearest point from its segment."""
        return to_segment(point, shape, shape.measures[1] / 2)

    @classmethod
    def around(cls, points: Array, axes: Sequence[int]) -> Wrapping:
        """Capsule of minimum volume whose segment goes through the middle of the extents along an axis."""
        import pinocchio as pin  # not needed to validate a section

        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        candidates = [(*_smallest(points - middle, axis), axis) for axis in axes]
        _, radius, half, shift, axis = min(candidates, key=lambda candidate: candidate[0])
        turn = np.roll(np.eye(3), 2 - axis, axis=1)  # own z along the axis
        placement = pin.SE3(turn, middle + shift * turn[:, 2]).homogeneous
        return Wrapping({"radius": radius, "length": 2 * half}, placement)

    def coal(self) -> Any:
        """Coal's capsule."""
        import coal

        return coal.Capsule(self.radius, self.length)

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """A cylinder and two balls."""
        del reach
        from spacerobot.description import Geometry

        rod, ball = np.array([self.radius, self.length]), Geometry("sphere", np.array([self.radius]))
        ends = [DrawnGeometry(ball, side * self.length / 2) for side in (1, -1)]
        return [DrawnGeometry(Geometry("cylinder", rod)), *ends]


def _smallest(points: Array, axis: int) -> tuple[float, float, float, float]:
    """Volume, radius, half length and shift along an axis of the smallest capsule about points (n, 3).

    A point at the distance d from the axis and height z is inside the capsule of radius r if the ends of its
    segment are at least z - s and at most z + s, with s = sqrt(r^2 - d^2). So only the radius is free.
    """
    height = points[:, axis]
    across = np.linalg.norm(np.delete(points, axis, axis=1), axis=1)
    min_radius, max_radius = float(across.max()), float(np.hypot(across, height).max())

    def ends(radius: float) -> tuple[float, float]:
        """Half length and shift of the segment."""
        reach = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
        top, bottom = float((height - reach).max()), float((height + reach).min())
        return max((top - bottom) / 2, 0.0), (top + bottom) / 2

    def volume(radius: float) -> float:
        """Volume of the cylinder and the two half balls."""
        return float(np.pi * radius**2 * (2 * ends(radius)[0] + 4 / 3 * radius))

    from scipy.optimize import minimize_scalar  # slow to import, and few scenes have meshes to wrap

    inside = (
        minimize_scalar(volume, bounds=(min_radius, max_radius), method="bounded").x
        if min_radius < max_radius
        else min_radius
    )
    radius = min((min_radius, float(inside), max_radius), key=volume)
    return volume(radius), radius, *ends(radius)
