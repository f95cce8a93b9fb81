"""Collision shapes for the geometry of a URDF: the shape itself, or a shape around it."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.description.parts import Geometry
from spacerobot.elements import CollisionShape, kinds
from spacerobot.elements.shapes.collision_shape import Wrap

AROUND = 8
"""Number of points on each rim of a cylinder: from a capsule along its axis, or a sphere, all are alike."""


def shape_of(geometry: Geometry, link: str) -> CollisionShape:
    """The collision shape that a URDF's primitive is.

    Args:
        geometry: No mesh.
        link: Link that carries it, as robot/link.
    """
    every: Any = kinds("shape").values()
    kind = next(kind for kind in every if kind.urdf_geometry == geometry.kind)
    return _made(kind, link, kind.of_urdf([float(x) for x in geometry.size]))


def wraps_around(geometry: Geometry) -> bool:
    """Whether a shape may replace a geometry: a mesh, or a cylinder with its edges."""
    return geometry.kind in ("mesh", "cylinder")


def wrapped(geometry: Geometry, wrap: Wrap, link: str) -> tuple[CollisionShape, Array]:
    """The collision shape around a mesh or a cylinder, and its placement (4, 4) [m] in the geometry's axes.

    No point of the geometry lies outside it.

    Args:
        geometry: A mesh or a cylinder.
        wrap: Kind of the shape.
        link: Link that carries it, as robot/link.
    """
    kind: Any = kinds("shape")[wrap]
    # points whose hull is the shape (n, 3) [m], own axes, and the axes along which a capsule may lie. Of a
    # cylinder they are some of its rims, each with all extremes along x and y.
    axes: tuple[int, ...]
    if geometry.mesh is not None:
        mesh = coal.MeshLoader().load(str(geometry.mesh), np.array(geometry.size))
        points, axes = np.array(mesh.vertices()), (0, 1, 2)
    else:
        radius, length = (float(x) for x in geometry.size)
        angles = 2 * np.pi * np.arange(AROUND) / AROUND
        rim = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
        ends = [np.column_stack([rim, np.full(AROUND, side * length / 2)]) for side in (-1, 1)]
        points, axes = np.concatenate(ends), (2,)
    measures, placement = kind.around(points, axes)
    return _made(kind, link, measures), placement


def _made(kind: Any, link: str, measures: dict[str, Any]) -> CollisionShape:
    """Shape without validation: URDFs are checked on reading, and an enclosing shape may be degenerate."""
    made: CollisionShape = kind.model_construct(link=link, **measures)
    return made
