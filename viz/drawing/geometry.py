"""Surfaces of URDF shapes."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from spacerobot.common.arrays import Array
from spacerobot.description import Geometry
from viz.drawing.meshes import TriangleMesh, load_mesh, mesh_file

_SIDES = 24  # of a cylinder's outline
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def faces(geometry: Geometry) -> list[Array]:
    """Flat faces of a box or a cylinder, corners counter-clockwise seen from outside.

    A cylinder has two, its ends; other shapes have none.

    Returns:
        list of arrays (k, 3): Corners in the shape's frame, m.
    """
    if geometry.kind == "box":
        corners = _CORNERS * geometry.size
        return [corners[list(face)] for face in _BOX_FACES]
    if geometry.kind == "cylinder":
        half = geometry.size[1] / 2
        return [_ring(geometry, -half)[::-1], _ring(geometry, half)]
    return []


def surface(geometry: Geometry) -> TriangleMesh:
    """Triangles of a box, a cylinder or a sphere, in the shape's frame."""
    if geometry.kind == "box":
        quads = np.array(_BOX_FACES)
        return TriangleMesh(_CORNERS * geometry.size, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    if geometry.kind == "cylinder":
        radius, half = geometry.size[0], geometry.size[1] / 2
        profile = [(0.0, -half), (radius, -half), (radius, half), (0.0, half)]
    else:
        polar = np.linspace(np.pi, 0, _SIDES // 2 + 1)
        profile = list(zip(geometry.size[0] * np.sin(polar), geometry.size[0] * np.cos(polar), strict=True))
    # Surface of a profile (k, 2) of radii and heights, from below to above, that is turned about z.
    outline = np.array(profile)
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    rings = [np.outer(outline[:, 0], np.cos(angle)), np.outer(outline[:, 0], np.sin(angle))]
    vertices = np.stack([*rings, np.repeat(outline[:, 1:], _SIDES, axis=1)], axis=-1).reshape(-1, 3)
    below = (_SIDES * np.arange(len(outline) - 1)[:, None] + np.arange(_SIDES)).ravel()
    next_below = below - below % _SIDES + (below + 1) % _SIDES
    above, across = below + _SIDES, next_below + _SIDES
    triangles = np.concatenate(
        [np.stack([below, next_below, across], 1), np.stack([below, across, above], 1)]
    )
    return TriangleMesh(vertices, triangles)


def is_round(geometry: Geometry) -> bool:
    """Whether a shape has curved faces, which :func:`faces` leaves out."""
    return geometry.kind in ("cylinder", "sphere")


def silhouette(geometry: Geometry, placement: Array, across: Array, up: Array) -> Array:
    """Outline (k, 2) [m] of a round shape in the picture plane spanned by ``across`` and ``up`` (3,).

    ``placement`` is the homogeneous transform (4, 4) from shape to world.
    """
    angles = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)]) * geometry.size[0]
    centre = np.array([placement[:3, 3] @ across, placement[:3, 3] @ up])
    if geometry.kind == "sphere":
        return np.asarray(centre + circle)
    ends = [_ring(geometry, height) for height in (-geometry.size[1] / 2, geometry.size[1] / 2)]
    world = np.concatenate(ends) @ placement[:3, :3].T + placement[:3, 3]
    flat = np.column_stack([world @ across, world @ up])
    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except QhullError:  # the silhouette has no area
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
        vertices = load_mesh(mesh_file(geometry)).vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return np.asarray((low + high) / 2 + _CORNERS * (high - low))
    return np.asarray(_CORNERS * edges)
