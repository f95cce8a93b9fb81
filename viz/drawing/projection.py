"""Scenes in parallel projection: polygons sorted by depth, or pixels for scenes with meshes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.image import AxesImage

from spacerobot.common.arrays import Array
from viz.drawing.geometry import faces, is_round, silhouette, surface
from viz.drawing.meshes import Indices, mesh_file, shown_meshes
from viz.drawing.motion import BodyMotion, Node
from viz.drawing.raster import Faces, Picture, cover, draw_faces
from viz.drawing.view import View

_LIGHT = np.array([-0.35, -0.45, 0.82])
_ROUND_SHADE = 0.85
_GHOST = (0.93, 0.93, 0.93)
_POINT_M = 1e-9


def draw_nodes(axes: Axes, motion: BodyMotion, frame: int, view: View, *, dpi: float = 300) -> None:
    """Draw all nodes at a frame, in axes whose limits are set.

    Scenes with meshes are drawn as one image of ``dpi`` pixels an inch, all others as polygons.
    """
    if has_meshes(motion):
        grid = _grid(axes, dpi)
        faces = _faces(motion, frame, view, range(len(motion.nodes)), grid)
        image = draw_faces(faces, grid.width, grid.height)
        image[..., :3] /= np.maximum(image[..., 3:], 1e-9)  # colours come premultiplied by their opacity
        _add_image(axes, np.clip(image, 0, 1), grid, zorder=3)
        return
    depths: list[float] = []
    polygons: list[Array] = []
    colours: list[Array] = []
    for placement, node in zip(motion.placements(frame), motion.nodes, strict=True):
        for depth, polygon, colour in _node_faces(node, placement, view):
            depths.append(depth)
            polygons.append(polygon)
            colours.append(colour)
    order = np.argsort(depths)
    fill = np.array([colours[i] for i in order]).reshape(-1, 4)
    edge = fill * [0.55, 0.55, 0.55, 1.0]
    axes.add_collection(
        PolyCollection(
            [polygons[i] for i in order], facecolors=fill, edgecolors=edge, linewidths=0.3, zorder=3
        )
    )


def draw_ghosts(axes: Axes, motion: BodyMotion, view: View, *, dpi: float = 300) -> None:
    """Draw bases and object in their initial poses, pale and below the rest; see :func:`draw_nodes`."""
    look: dict[str, Any] = {"linewidths": 0.5, "linestyles": "--", "zorder": 2}
    if has_meshes(motion):
        grid = _grid(axes, dpi)
        covered = _ghosts(motion, view, grid)
        image = np.concatenate([np.broadcast_to(_GHOST, (*covered.shape, 3)), covered[..., None]], axis=-1)
        _add_image(axes, image, grid, zorder=1.9)
        if np.ptp(covered) > 0:
            axes.contour(covered, [0.5], extent=grid.extent, origin="upper", colors="0.55", **look)
        return
    polygons = [
        polygon
        for placement, node in zip(motion.placements(0), motion.nodes, strict=True)
        if node.is_base
        for _, polygon, _ in _node_faces(node, placement, view)
    ]
    axes.add_collection(PolyCollection(polygons, facecolors=_GHOST, edgecolors="0.55", **look))


def has_meshes(motion: BodyMotion) -> bool:
    """Whether any visible shape is a mesh."""
    return any(solid.geometry.kind == "mesh" for node in motion.nodes for solid in node.solids)


class _Grid(NamedTuple):
    """Pixel grid that fills axes: sides (left, right, bottom, top) and numbers of pixels."""

    extent: tuple[float, float, float, float]
    width: int
    height: int


def _grid(axes: Axes, dpi: float) -> _Grid:
    """Pixel grid for the present limits of axes."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    figure = axes.get_figure(root=True)
    inches = axes.get_position().width * (figure.get_figwidth() if figure else 1.0)
    width = max(1, round(inches * dpi))
    return _Grid((left, right, bottom, top), width, max(1, round(width * (top - bottom) / (right - left))))


def _add_image(axes: Axes, image: Array, grid: _Grid, zorder: float) -> None:
    axes_image = AxesImage(axes, extent=grid.extent, origin="upper", zorder=zorder)
    axes_image.set_data(image)
    axes.add_image(axes_image)


@lru_cache(maxsize=2)
def _ghosts(motion: BodyMotion, view: View, grid: _Grid) -> Picture:
    """Fraction (h, w) of each pixel that bases cover at the first frame; cached, as all pictures show it."""
    bases = [k for k, node in enumerate(motion.nodes) if node.is_base]
    return cover(_faces(motion, 0, view, bases, grid).corners, grid.width, grid.height)


def _faces(motion: BodyMotion, frame: int, view: View, node_indices: Iterable[int], grid: _Grid) -> Faces:
    """Faces of selected nodes in pixels, lit on the side that faces the viewer."""
    to_picture = np.stack([view.across, view.up, view.towards])
    left, right, bottom, top = grid.extent
    scale = [grid.width / (right - left), -grid.height / (top - bottom), 1.0]
    surfaces, placements, parts = _node_surfaces(motion.nodes), motion.placements(frame), []
    for k in node_indices:
        vertices, triangles, rgba, part = surfaces[k]
        to_world = placements[k]
        corners = ((vertices @ to_world[:3, :3].T + to_world[:3, 3]) @ to_picture.T)[triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # files do not agree on which way round the corners go
        length = np.linalg.norm(normal, axis=1) * np.where(normal[:, 2] < 0, -1.0, 1.0)
        shade = _shade(normal @ (to_picture @ _LIGHT) / np.where(length == 0, 1.0, length))
        lit = rgba * np.stack([shade, shade, shade, np.ones(len(shade))], axis=1)
        parts.append(((corners - [left, top, 0.0]) * scale, lit, part))
    return Faces(*map(np.concatenate, zip(*parts, strict=True)))


class _NodeSurface(NamedTuple):
    """Vertices (n, 3) of a node in its frame, triangles (m, 3), their colours (m, 4) and solids (m,)."""

    vertices: Array
    triangles: Indices
    rgba: Array
    part: Indices


@lru_cache(maxsize=16)
def _node_surfaces(nodes: tuple[Node, ...]) -> list[_NodeSurface]:
    """Surface of each node; solids are numbered across nodes."""
    solids = [solid for node in nodes for solid in node.solids]
    meshes = shown_meshes(mesh_file(s.geometry) for s in solids if s.geometry.kind == "mesh")
    numbers, surfaces = count(), []
    for node in nodes:
        vertices, triangles = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)]
        rgba, part = [np.zeros((0, 4))], [np.zeros(0, dtype=np.int64)]
        for solid in node.solids:
            geometry = solid.geometry
            shape = meshes[mesh_file(geometry)] if geometry.kind == "mesh" else surface(geometry)
            triangles.append(shape.triangles + sum(map(len, vertices)))
            vertices.append(shape.vertices @ solid.placement[:3, :3].T + solid.placement[:3, 3])
            rgba.append(np.tile(solid.rgba, (len(shape.triangles), 1)))
            if shape.colours is not None:
                rgba[-1][:, :3] = shape.colours / 255
            part.append(np.full(len(shape.triangles), next(numbers)))
        surfaces.append(
            _NodeSurface(
                np.concatenate(vertices),
                np.concatenate(triangles),
                np.concatenate(rgba),
                np.concatenate(part),
            )
        )
    return surfaces


def _shade(towards_light: Array) -> Array:
    return np.asarray(0.62 + 0.38 * np.maximum(0.0, towards_light))


def _node_faces(node: Node, placement: Array, view: View) -> list[tuple[float, Array, Array]]:
    """Depth, outline and colour of the faces that look at the eye."""
    faces_by_node = []
    for solid in node.solids:
        to_world = placement @ solid.placement
        if is_round(solid.geometry):
            outline, centre = silhouette(solid.geometry, to_world, view.across, view.up), to_world[:3, 3]
            colour = solid.rgba * [_ROUND_SHADE, _ROUND_SHADE, _ROUND_SHADE, 1.0]
            faces_by_node.append((float(centre @ view.towards), outline, colour))
        for face in faces(solid.geometry):
            points = face @ to_world[:3, :3].T + to_world[:3, 3]
            normal = np.cross(points[1] - points[0], points[2] - points[1])
            length = np.linalg.norm(normal)
            if length == 0 or normal @ view.towards <= 1e-9 * length:
                continue
            shade = float(_shade(normal @ _LIGHT / length))
            colour = solid.rgba * [shade, shade, shade, 1.0]
            faces_by_node.append((float((points @ view.towards).mean()), view.flat(points), colour))
    return faces_by_node


def fit(axes: Axes, points: Array, view: View, *, margin: float = 0.04, shape: float | None = None) -> None:
    """Set equal scales and limits so that world points fit the picture; a single point gets a metre.

    Args:
        axes: The picture.
        points: Points to include (k, 3) [m].
        view: Direction of view.
        margin: Margin around the points, as a fraction of the longer side.
        shape: Height of the picture over its width; as the points need it if None.
    """
    flat = view.flat(points)
    lowest, highest = flat.min(axis=0), flat.max(axis=0)
    side = float((highest - lowest).max())
    if side < _POINT_M:  # nothing but a point, such as the one joint of a robot without shapes
        margin, side = 0.5, 1.0
    size = (highest - lowest) + 2 * margin * side
    if shape is not None:
        size = np.array([max(size[0], size[1] / shape), max(size[1], size[0] * shape)])
    middle = (lowest + highest) / 2
    axes.set_xlim(middle[0] - size[0] / 2, middle[0] + size[0] / 2)
    axes.set_ylim(middle[1] - size[1] / 2, middle[1] + size[1] / 2)
    axes.set_aspect("equal")
