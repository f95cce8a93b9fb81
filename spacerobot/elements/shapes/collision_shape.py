"""Collision shapes: convex bodies fixed to links, as pads of a scenario or as collision geometry of URDFs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.registry import required
from spacerobot.common.section import OneOf, Vector, quantity
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.registry import kinds
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.shapes import Nearest, Shape, Support

if TYPE_CHECKING:
    from spacerobot.description import Geometry

_GOLDEN = math.pi * (3 - 5**0.5)
_SAMPLED = 400
"""Number of directions in which a shape's surface is sampled, in addition to its axes."""


class DrawnGeometry(NamedTuple):
    """Part of a shape's drawing: geometry, shift along the shape's z axis [m], and opacity."""

    geometry: Geometry
    along: float = 0.0
    opacity: float = 1.0


class Wrapping(NamedTuple):
    """A shape around points: its measures by key, and its placement (4, 4) [m] in their frame."""

    measures: dict[str, Any]
    placement: Array


class CollisionShape(Element):
    """Convex shape fixed to a link, without mass.

    A kind adds its measures as keys, and defines its support function, from which distances follow; a
    half-space has none. Everything else has a default that follows from the support function.

    Attributes:
        is_halfspace: Whether it is the half-space below its own x-y plane.
        urdf_geometry: Corresponding geometry in a URDF, if there is one.
        wrap_order: Rank among the shapes that plans try around meshes and cylinders; None if it cannot wrap.
    """

    family: ClassVar[str] = "shape"
    is_halfspace: ClassVar[bool] = False
    urdf_geometry: ClassVar[str | None] = None
    wrap_order: ClassVar[int | None] = None

    link: str = Field(
        pattern=r"^[^/]+/[^/]+$", description="link that carries the shape, as robot/link or target/link"
    )
    position: Vector = quantity("m", "its own origin, link axes", default=(0.0, 0.0, 0.0))
    rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of its own axes in the link's", default=(0.0, 0.0, 0.0)
    )

    @classmethod
    @required("not is_halfspace")
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Support function about its origin.

        Args:
            rotation: Rotation from the shape's own axes to those of the result (3x3).
            measures: Lengths (n x 1) [m], in the order of the shape's keys.
        """
        raise NotImplementedError

    @classmethod
    def nearest(cls, point: ca.SX, shape: Shape) -> Nearest | None:
        """Signed distance from a point to the shape without its ball, where that has a closed form.

        Args:
            point: The point (3x1) [m], world axes.
            shape: Pose of the shape.

        Returns:
            tuple or None: Distance (1x1) [m], unit direction to the point (3x1), nearest point of the core
                (3x1) [m]; None if support functions are to give the distance.
        """
        del point, shape
        return None

    @classmethod
    @required("urdf_geometry")
    def of_urdf(cls, size: Sequence[float]) -> dict[str, Any]:
        """Measures by key, from the size of the URDF's geometry of the same name [m]."""
        raise NotImplementedError

    @classmethod
    @required("wrap_order")
    def around(cls, points: Array, axes: Sequence[int]) -> Wrapping:
        """The shape around points.

        Args:
            points: Points to be contained (n, 3) [m].
            axes: Axes along which it may lie: 0, 1, 2.
        """
        raise NotImplementedError

    @model_validator(mode="after")
    def _check_measures(self) -> CollisionShape:
        for key in self.measure_keys():
            measure = getattr(self, key)
            if isinstance(measure, tuple) and min(measure) <= 0:
                raise ValueError(f"{key}: found {list(measure)}, allowed: numbers above 0")
        return self

    @classmethod
    def measure_keys(cls) -> tuple[str, ...]:
        """Keys of its measures."""
        return tuple(key for key in cls.model_fields if key not in CollisionShape.model_fields)

    def measures(self, context: SectionContext | None = None) -> ca.SX:
        """Measures of the shape (n x 1) [m]: numbers, or symbols with the context of its section."""
        if context is None:
            values = [ca.SX(ca.DM(getattr(self, key))) for key in self.measure_keys()]
        else:
            values = [
                context.vector(key) if isinstance(getattr(self, key), tuple) else context.number(key)
                for key in self.measure_keys()
            ]
        return ca.vertcat(*values) if values else ca.SX(0, 1)

    def surface_points(self) -> Array:
        """Surface points (n, 3) [m], own axes: the support points in directions all around."""
        support, none = self.support(ca.SX.eye(3), self.measures()), ca.SX(1e-6)
        n = ca.SX.sym("n", 3)
        farthest = sum((term.farthest(n, none) for term in support.terms), support.ball * n)
        farthest_points = ca.Function("farthest", [n], [farthest])(directions().T)
        return np.asarray(farthest_points.full().T)

    def extent(self) -> tuple[float, float]:
        """Minimum and maximum distance of its support planes from its origin [m].

        Infinite for a half-space.
        """
        if self.is_halfspace:
            return math.inf, math.inf
        reach = np.einsum("ij,ij->i", directions(), self.surface_points())
        return float(reach.min()), float(reach.max())

    def coal(self) -> Any:
        """Geometry in coal, which the Pinocchio engine uses: the convex hull of points of its surface.

        The engine starts from coal's distance and refines it by the support function.
        """
        import coal

        points = coal.StdVec_Vec3s()
        points.extend(list(self.surface_points()))
        return coal.Convex.convexHull(points, False, "")

    def drawing(self, reach: float) -> list[DrawnGeometry]:
        """Drawn geometry: the hull of its surface points.

        Args:
            reach: Distance from its origin to the farthest of the shapes that may touch it [m]; for a
                half-space.
        """
        del reach
        from spacerobot.description import Geometry

        return [DrawnGeometry(Geometry("mesh", np.ones(3), corners=self.surface_points()))]

    def words(self) -> str:
        """Kind and measures."""
        sizes = [(key, np.atleast_1d(getattr(self, key))) for key in self.measure_keys()]
        return ", ".join(
            [self.kind, *(f"{key} {' x '.join(f'{x:g}' for x in values)} m" for key, values in sizes)]
        )


def wrapping_shapes() -> list[str]:
    """Names of the kinds that can replace meshes and cylinders, the closest fit first."""
    places = [(getattr(kind, "wrap_order", None), name) for name, kind in kinds("shape").items()]
    return [name for _, name in sorted((place, name) for place, name in places if place is not None)]


Wrap = Annotated[str, OneOf(wrapping_shapes)]
"""Shape that replaces meshes and cylinders."""


def directions() -> Array:
    """Unit vectors all around (n, 3): both senses of the axes, and a spiral."""
    height = np.linspace(-1, 1, _SAMPLED)
    around = np.sqrt(1 - height**2) * np.exp(1j * _GOLDEN * np.arange(_SAMPLED))
    return np.vstack([np.eye(3), -np.eye(3), np.column_stack([around.real, around.imag, height])])
