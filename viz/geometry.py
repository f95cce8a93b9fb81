"""Surfaces of the shapes that a URDF names."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from spacerobot.description import Geometry

Array = NDArray[np.float64]

_SIDES = 24  # of a cylinder's outline
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def faces(geometry: Geometry) -> list[Array]:
    """Flat faces of a shape, corners counter-clockwise seen from outside.

    Of a cylinder these are its two ends; a sphere has none.

    Returns
    -------
    list of arrays (k, 3)
        Corners in the shape's frame, m.
    """
    if geometry.kind == "box":
        corners = _CORNERS * geometry.size
        return [corners[list(face)] for face in _BOX_FACES]
    if geometry.kind == "cylinder":
        half = geometry.size[1] / 2
        return [_ring(geometry, -half)[::-1], _ring(geometry, half)]
    if geometry.kind == "sphere":
        return []
    vertices, triangles = load_mesh(_path(geometry), tuple(float(x) for x in geometry.size))
    return list(vertices[triangles])


def is_round(geometry: Geometry) -> bool:
    """Whether a shape has curved faces, which :func:`faces` leaves out."""
    return geometry.kind in ("cylinder", "sphere")


def silhouette(geometry: Geometry, placement: Array, across: Array, up: Array) -> Array:
    """Outline (k, 2) of a round shape in the picture that ``across`` and ``up`` (3,) span, m.

    ``placement`` is from the shape to the world, homogeneous (4, 4).
    """
    turned = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    circle = np.column_stack([np.cos(turned), np.sin(turned)]) * geometry.size[0]
    centre = np.array([placement[:3, 3] @ across, placement[:3, 3] @ up])
    if geometry.kind == "sphere":
        return np.asarray(centre + circle)
    ends = [_ring(geometry, height) for height in (-geometry.size[1] / 2, geometry.size[1] / 2)]
    world = np.concatenate(ends) @ placement[:3, :3].T + placement[:3, 3]
    flat = np.column_stack([world @ across, world @ up])
    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except QhullError:  # seen exactly from nowhere: no area
        return flat[:1]


def _ring(geometry: Geometry, height: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    radius = geometry.size[0]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(_SIDES, height)])


def corners(geometry: Geometry) -> Array:
    """Corners of a box around a shape (8, 3), in the shape's frame, m."""
    if geometry.kind == "box":
        edges = geometry.size
    elif geometry.kind == "cylinder":
        edges = np.array([2 * geometry.size[0], 2 * geometry.size[0], geometry.size[1]])
    elif geometry.kind == "sphere":
        edges = np.full(3, 2 * geometry.size[0])
    else:
        vertices, _ = load_mesh(_path(geometry), tuple(float(x) for x in geometry.size))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return np.asarray((low + high) / 2 + _CORNERS * (high - low))
    return np.asarray(_CORNERS * edges)


@lru_cache(maxsize=256)
def load_mesh(path: Path, scale: tuple[float, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) in m and triangles (m, 3) of a mesh file, by the library that Pinocchio uses."""
    import coal  # only scenes with meshes pay for its import

    model: Any = coal.MeshLoader().load(str(path), np.array(scale))
    vertices = np.array(model.vertices(), dtype=np.float64).reshape(-1, 3)
    triangles = [
        [triangle[k] for k in range(3)] for triangle in map(model.tri_indices, range(model.num_tris))
    ]
    return vertices, np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _path(geometry: Geometry) -> Path:
    if geometry.mesh is None:
        raise ValueError("a mesh without a file")
    return geometry.mesh
