"""Mesh files as surfaces with a limited number of triangles."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from spacerobot.common.arrays import Array
from spacerobot.description import Geometry
from spacerobot.description.meshes import read_mesh

Indices = NDArray[np.int64]
Colours = NDArray[np.uint8]

MOST_TRIANGLES = 60_000
"""Maximum total number of triangles of all different meshes of a scene."""

_FINEST = 1 / 300  # of the longest mesh: the first edge of cells that is tried
_FEWEST_CELLS = 10  # across any mesh, however small it is beside others
_PULL = 1e-3  # towards the mean of a cell's vertices, in directions in which its faces say nothing


class TriangleMesh(NamedTuple):
    """Triangle mesh with optional colours.

    Attributes:
        vertices: Vertices (n, 3) [m].
        triangles: Vertex indices (m, 3), counter-clockwise seen from outside.
        colours: Red, green, blue (m, 3) of the triangles, 0 to 255; None if the file has no colours.
    """

    vertices: Array
    triangles: Indices
    colours: Colours | None = None


class MeshFile(NamedTuple):
    """A mesh as a shape names it: path of its file, or corners of a convex hull, and its scale (3,)."""

    path: Path | None
    scale: tuple[float, ...]
    corners: tuple[tuple[float, ...], ...] = ()


def mesh_file(geometry: Geometry) -> MeshFile:
    """Mesh file that a shape of the kind ``mesh`` names."""
    corners = () if geometry.corners is None else tuple(map(tuple, geometry.corners.tolist()))
    if geometry.mesh is None and not corners:
        raise ValueError("a mesh without a file")
    return MeshFile(geometry.mesh, tuple(float(x) for x in geometry.size), corners)


@lru_cache(maxsize=256)
def load_mesh(file: MeshFile) -> TriangleMesh:
    """Complete surface of a mesh file, read by Pinocchio's geometry library, or of a convex hull."""
    if file.path is None:
        # Convex hull of points (n, 3), whose triangles Qhull gives in either sense.
        points = np.array(file.corners) * file.scale
        hull = ConvexHull(points)
        a, b, c = (points[hull.simplices[:, k]] for k in range(3))
        inward = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0
        triangles = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
        return _compact(points, triangles.astype(np.int64), None)
    model = read_mesh(file.path, file.scale)
    vertices = np.array(model.vertices(), dtype=np.float64).reshape(-1, 3)
    triangles = list(map(model.tri_indices, range(model.num_tris)))
    corners = [
        np.fromiter(map(itemgetter(k), triangles), dtype=np.int64, count=len(triangles)) for k in range(3)
    ]
    plain = TriangleMesh(vertices, np.stack(corners, axis=1))
    return _coloured(file, plain) or plain


_COLOURED = (".dae", ".obj", ".gltf", ".glb", ".ply")
_LINEAR = (".gltf", ".glb")  # the colour factors of whose materials are of linear light
_TURNS = (np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))  # as it is; y up to z up


def _coloured(file: MeshFile, plain: TriangleMesh) -> TriangleMesh | None:
    """Mesh with the colours of its file's materials and textures; None if it has none.

    Pinocchio's geometry library reads no materials, and returns wrong triangles for a node with several parts
    (one for each material). So trimesh reads the file, and the result is scaled and oriented to match
    ``plain``, since readers treat units and the upward axis differently.
    """
    if file.path is None or file.path.suffix.lower() not in _COLOURED or not len(plain.vertices):
        return None
    import trimesh  # comes with yourdfpy; only meshes that may have colours pay for its import

    try:
        bodies: Any = trimesh.load_scene(file.path).dump()
        parts = [part for part in bodies if part.visual.defined]
        # colours (m, 3) of each part's triangles, 0 to 255: of its faces, vertices, texture or material
        colours = []
        for part in parts:
            look = part.visual
            if look.kind != "texture":
                colours.append(np.asarray(look.face_colors[:, :3], dtype=np.float64))
                continue
            material = look.material
            texture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
            if texture is not None and look.uv is not None:
                colours.append(np.asarray(material.to_color(look.uv)[part.faces][..., :3].mean(axis=1)))
                continue
            colour = np.asarray(material.main_color[:3], dtype=np.float64)
            if file.path.suffix.lower() in _LINEAR:
                colour = 255 * (colour / 255) ** (1 / 2.2)
            colours.append(np.tile(colour, (len(part.faces), 1)))
    except Exception:  # a colour is no reason to refuse a mesh; trimesh's readers raise whatever they meet
        return None
    if not parts:
        return None
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    triangles = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    extents: Array = np.ptp(plain.vertices / np.array(file.scale), axis=0)
    fits: list[tuple[float, float]] = []
    for turn in _TURNS:
        spans: Array = np.ptp(vertices @ turn.T, axis=0)
        factor = float(np.linalg.norm(extents)) / max(float(np.linalg.norm(spans)), 1e-12)
        fits.append((float(np.abs(extents - factor * spans).sum()), factor))
    best = int(np.argmin([misfit for misfit, _ in fits]))
    placed = vertices @ _TURNS[best].T * fits[best][1] * file.scale
    return TriangleMesh(placed, triangles.astype(np.int64), np.concatenate(colours).astype(np.uint8))


def shown_meshes(files: Iterable[MeshFile]) -> dict[MeshFile, TriangleMesh]:
    """Surfaces of mesh files, simplified alike until all have :data:`MOST_TRIANGLES` together."""
    return _shown_meshes(tuple(dict.fromkeys(files)))


@lru_cache(maxsize=16)
def _shown_meshes(files: tuple[MeshFile, ...]) -> dict[MeshFile, TriangleMesh]:
    full = {file: load_mesh(file) for file in files}
    extents = {file: float(np.ptp(s.vertices, axis=0).max(initial=0.0)) for file, s in full.items()}
    meshes, cell, before = full, _FINEST * max(extents.values(), default=0.0), 0
    while MOST_TRIANGLES < (count := sum(len(s.triangles) for s in meshes.values())) != before:
        cell *= max(1.1, count / MOST_TRIANGLES) if before else 1.0
        meshes = {f: simplified(s, min(cell, extents[f] / _FEWEST_CELLS)) for f, s in full.items()}
        before = count
    return meshes


def simplified(surface: TriangleMesh, cell: float) -> TriangleMesh:
    """Surface with the vertices in each cell of a grid merged into one.

    The merged vertex minimises the squared distances from the planes of the cell's faces, so that edges and
    corners stay sharp. It stays inside the cell, so nothing moves by more than the cell's diagonal.

    Args:
        surface: Surface to simplify.
        cell: Edge length of the grid's cells [m].
    """
    vertices, triangles, colours = surface
    place = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    owner = _numbered(place)
    size = int(owner.max()) + 1
    mean = _sums(owner, vertices, size) / np.bincount(owner, minlength=size)[:, None]
    merged = owner[triangles]
    is_triangle = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    _, first = np.unique(_numbered(np.sort(merged[is_triangle], axis=1)), return_index=True)
    best = mean + np.clip(_meeting_points(surface, owner, mean), -cell / 2, cell / 2)
    remaining = np.flatnonzero(is_triangle)[np.sort(first)]
    return _compact(best, merged[remaining], None if colours is None else colours[remaining])


def _meeting_points(surface: TriangleMesh, owner: Indices, mean: Array) -> Array:
    """Point (size, 3) nearest to the planes of the faces at each cell's vertices, from the vertices' mean."""
    corners = surface.vertices[surface.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0, length, 1.0)
    matrix, vector = np.zeros((len(mean), 3, 3)), np.zeros((len(mean), 3))
    for k in range(3):
        cells = owner[surface.triangles[:, k]]
        height = np.sum(normal * (corners[:, k] - mean[cells]), axis=1)
        weighted = length * normal
        outer = (weighted[:, :, None] * normal[:, None, :]).reshape(-1, 9)
        matrix += _sums(cells, outer, len(mean)).reshape(-1, 3, 3)
        vector += _sums(cells, weighted * height[:, None], len(mean))
    pull = _PULL * np.trace(matrix, axis1=1, axis2=2) + np.finfo(float).tiny
    return np.asarray(np.linalg.solve(matrix + pull[:, None, None] * np.eye(3), vector[..., None])[..., 0])


def _numbered(rows: Indices) -> Indices:
    """Index (n,) of each row (n, c) of nonnegative numbers among the distinct rows."""
    numbers = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        _, numbers = np.unique(numbers * (column.max(initial=0) + 1) + column, return_inverse=True)
    return numbers


def _sums(owner: Indices, values: Array, size: int) -> Array:
    """Sums (size, c) of the rows (n, c) with the same index ``owner``."""
    return np.stack([np.bincount(owner, column, minlength=size) for column in values.T], axis=1)


def _compact(vertices: Array, triangles: Indices, colours: Colours | None) -> TriangleMesh:
    """Mesh without the vertices that belong to no triangle."""
    used, renamed = np.unique(triangles, return_inverse=True)
    return TriangleMesh(vertices[used], renamed.reshape(-1, 3), colours)
