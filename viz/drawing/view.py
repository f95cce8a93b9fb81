"""Directions of view for pictures, figures and pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.geometry import corners
from viz.drawing.motion import BodyMotion, initial_motion, sample_motion

_AZIMUTH_DEG, _ELEVATION_DEG = -60.0, 25.0
_TURNS_DEG = (0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180)
"""Azimuths relative to the usual one [deg], in order of preference."""

_ELEVATIONS_DEG = (25.0, 50.0, 5.0, -20.0)
"""Elevations of views of a grasp [deg], in order of preference."""

_AS_GOOD = 0.1  # less of what matters may be hidden by a direction that is preferred
_NEARLY = 0.02  # the same, where a grasp shall be seen
_BESIDE = (-20.0, 0.0, 20.0)  # deg, azimuths about that of a view of a grasp which shall see it, too
_NEAR = 0.01  # of the largest box: what is nearer than this hides nothing


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection.

    Attributes:
        across, up: World directions that point right and up in the picture (3,).
        labels: Labels of the two axes of the picture; empty if they are not world axes.
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
"""View from above, for planar scenes."""


def oblique(azimuth_deg: float = _AZIMUTH_DEG, elevation_deg: float = _ELEVATION_DEG) -> View:
    """View from outside and above, for spatial scenes; z points up."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    across = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return View(across, up, ("", ""))


def view_of(result: Result, scene: Scene) -> View:
    """View of a result: from above for planar scenes, otherwise the oblique view that hides arms least."""
    rows = len(result.data.time)
    times = [e["time_s"] for e in result.summary.get("events", ()) if e["kind"] == "captured"]
    places = np.searchsorted(result.array("time"), times).clip(0, len(result.data.time) - 1)
    captured = sorted({int(row) for row in places})
    sample_rows = [0, rows // 2, rows - 1, *captured]
    return TOP if scene.planar else _clearest(sample_motion(result, scene, sample_rows))


def grasp_view(motion: BodyMotion, frames: Sequence[int], usual: View) -> View:
    """Oblique view that hides the grasps least; among equal ones the nearest to the usual view.

    Args:
        motion: Bodies, with the points of the grasps as its ``mates``.
        frames: Frames to consider, with equal weight.
        usual: View from which azimuths are measured.

    Returns:
        View: View from one of several azimuths, at one of a few elevations.
    """
    azimuth = float(np.degrees(np.arctan2(usual.towards[1], usual.towards[0])))
    turns = [(turn, up) for up in _ELEVATIONS_DEG for turn in _TURNS_DEG]
    views = [oblique(azimuth + turn, up) for turn, up in turns]
    # only the grasps matter; a side is good if its neighbours are, from which a grasp at the edge is hidden
    contents = [_frame(motion, index)._replace(links=np.zeros((0, 3))) for index in frames]
    shares = np.array(
        [
            np.mean(
                [frame.seen(oblique(azimuth + turn + by, up).towards) for frame in contents for by in _BESIDE]
            )
            for turn, up in turns
        ]
    )
    away = np.array([abs(turn) / 90 + abs(up - _ELEVATION_DEG) / 60 for turn, up in turns])
    return views[int(np.argmin(np.where(shares >= shares.max() - _NEARLY, away, np.inf)))]


def first_view(scene: Scene) -> View:
    """View of a scene before its simulation, chosen as in :func:`view_of`."""
    return TOP if scene.planar else _clearest(initial_motion(scene))


def _clearest(motion: BodyMotion) -> View:
    """Oblique view with the fewest hidden links and grasps; of equal ones the nearest to the usual view."""
    views = [oblique(_AZIMUTH_DEG + turn) for turn in _TURNS_DEG]
    frames = [_frame(motion, k) for k in range(len(motion.time))]
    visibility = np.array([np.mean([frame.seen(view.towards) for frame in frames]) for view in views])
    return views[int(np.argmax(visibility >= visibility.max() - _AS_GOOD))]


class _Frame(NamedTuple):
    """Boxes of a frame for visibility tests, and the points that should be visible.

    Attributes:
        links, mates: Centres of the arms' shapes (l, 3) and points of grasps (m, 3), world [m].
        placements, halves: Boxes around shapes of bases and of the target, which hide points behind them:
            transforms to the world (b, 4, 4), and half edges (b, 3) [m]. Occlusion of an arm by itself is
            ignored, since the boxes of its links overlap.
        near: Distance [m] within which nothing hides a point.
    """

    links: Array
    mates: Array
    placements: Array
    halves: Array
    near: float

    def seen(self, towards: Array) -> float:
        """Fraction of visible links and grasps, with equal weight, from a direction; 1 if there are none."""
        to_boxes, shares = self.placements[:, :3, :3].transpose(0, 2, 1), []
        along = to_boxes @ towards
        along = np.where(np.abs(along) < 1e-12, 1e-12, along)
        for points in (self.links, self.mates):
            if not len(points):
                continue
            # a box lies between a point and the eye; one that holds the point does not
            start = np.einsum("bij,kbj->kbi", to_boxes, points[:, None] - self.placements[:, :3, 3])
            first, second = (-self.halves - start) / along, (self.halves - start) / along
            enter, leave = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
            hidden = ((leave > np.maximum(enter, self.near)) & (enter > -self.near)).any(axis=-1)
            shares.append(1 - hidden.mean())
        return float(np.mean(shares)) if shares else 1.0


def _frame(motion: BodyMotion, index: int) -> _Frame:
    arms: list[tuple[Array, Array]] = []
    base_boxes: list[tuple[Array, Array]] = []
    for placement, node in zip(motion.placements(index), motion.nodes, strict=True):
        # placement in the world and half the edges of a box around each shape
        link_points = []
        for solid in node.solids:
            around = corners(solid.geometry)
            to_world = placement @ solid.placement
            to_world[:3, 3] += to_world[:3, :3] @ around.mean(axis=0)
            link_points.append((to_world, np.ptp(around, axis=0) / 2))
        is_arm = node.body != "target" and not node.is_base
        (arms if is_arm else base_boxes).extend(link_points)
    links, placements = (
        np.array([placement for placement, _ in boxes]).reshape(-1, 4, 4) for boxes in (arms, base_boxes)
    )
    halves = np.array([half for _, half in base_boxes]).reshape(-1, 3)
    size = 2 * float(np.linalg.norm(halves, axis=1).max(initial=0.0))
    return _Frame(links[:, :3, 3], motion.mates[index], placements, halves, _NEAR * size)
