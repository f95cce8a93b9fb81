"""Scenes as flat polygons: parallel projection, far faces first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from viz.geometry import Array, faces, is_round, silhouette
from viz.motion import Motion, Node

_LIGHT = np.array([-0.35, -0.45, 0.82])
_ROUND_SHADE = 0.85
_POINT_M = 1e-9


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection.

    Attributes
    ----------
    across, up
        World directions that point right and up in the picture (3,).
    labels
        What to write at the two axes; empty where they are no world axes.
    """

    across: Array
    up: Array
    labels: tuple[str, str]

    @property
    def towards(self) -> Array:
        """Direction from the scene to the eye (3,)."""
        return np.cross(self.across, self.up)

    def flat(self, points: Array) -> Array:
        """Picture coordinates (..., 2) of world points (..., 3), m."""
        return np.stack([points @ self.across, points @ self.up], axis=-1)


TOP = View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), ("x [m]", "y [m]"))
"""From above, for planar scenes."""


def oblique(azimuth_deg: float = -60.0, elevation_deg: float = 25.0) -> View:
    """From outside and above, for spatial scenes; z points up."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    across = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return View(across, up, ("", ""))


def view_of(planar: bool) -> View:
    """The view that suits a scene."""
    return TOP if planar else oblique()


def draw_nodes(axes: Axes, motion: Motion, frame: int, view: View, *, opacity: float = 1.0) -> PolyCollection:
    """Draw all nodes as they stand at a frame."""
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
    fill[:, 3] *= opacity
    edge = fill * [0.55, 0.55, 0.55, 1.0]
    drawn = PolyCollection(
        [polygons[i] for i in order], facecolors=fill, edgecolors=edge, linewidths=0.3, zorder=3
    )
    axes.add_collection(drawn)
    return drawn


def draw_ghosts(axes: Axes, motion: Motion, view: View) -> PolyCollection:
    """Bases and object where each of them began, pale, behind what is drawn."""
    polygons = [
        polygon
        for placement, node in zip(motion.placements(0), motion.nodes, strict=True)
        if node.is_base
        for _, polygon, _ in _node_faces(node, placement, view)
    ]
    ghosts = PolyCollection(
        polygons, facecolors="0.93", edgecolors="0.55", linewidths=0.5, linestyles="--", zorder=2
    )
    axes.add_collection(ghosts)
    return ghosts


def _node_faces(node: Node, placement: Array, view: View) -> list[tuple[float, Array, Array]]:
    """Depth, outline and colour of the faces that look at the eye."""
    found = []
    for solid in node.solids:
        to_world = placement @ solid.placement
        if is_round(solid.geometry):
            outline, centre = silhouette(solid.geometry, to_world, view.across, view.up), to_world[:3, 3]
            colour = solid.rgba * [_ROUND_SHADE, _ROUND_SHADE, _ROUND_SHADE, 1.0]
            found.append((float(centre @ view.towards), outline, colour))
        for face in faces(solid.geometry):
            points = face @ to_world[:3, :3].T + to_world[:3, 3]
            normal = np.cross(points[1] - points[0], points[2] - points[1])
            length = np.linalg.norm(normal)
            if length == 0 or normal @ view.towards <= 1e-9 * length:
                continue
            shade = 0.62 + 0.38 * max(0.0, float(normal @ _LIGHT) / float(length))
            colour = solid.rgba * [shade, shade, shade, 1.0]
            found.append((float((points @ view.towards).mean()), view.flat(points), colour))
    return found


def fit(axes: Axes, points: Array, view: View, *, margin: float = 0.04, shape: float | None = None) -> None:
    """Set equal scales and limits so that points of the world fit the picture, a metre where they are one.

    Parameters
    ----------
    axes
        The picture.
    points
        What must be seen (k, 3), m.
    view
        How it is seen.
    margin
        Room around it, as a share of its longer side.
    shape
        Height of the picture over its width, to fill it; as the points need it if not given.
    """
    flat = view.flat(points)
    least, greatest = flat.min(axis=0), flat.max(axis=0)
    side = float((greatest - least).max())
    if side < _POINT_M:  # nothing but a point, such as the one joint of a robot without shapes
        margin, side = 0.5, 1.0
    size = (greatest - least) + 2 * margin * side
    if shape is not None:
        size = np.array([max(size[0], size[1] / shape), max(size[1], size[0] * shape)])
    middle = (least + greatest) / 2
    axes.set_xlim(middle[0] - size[0] / 2, middle[0] + size[0] / 2)
    axes.set_ylim(middle[1] - size[1] / 2, middle[1] + size[1] / 2)
    axes.set_aspect("equal")
