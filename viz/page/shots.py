"""Camera shots of a motion: the approach, a close-up of each capture, and the whole scene; or a drift."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.motion import BodyMotion, extremes
from viz.drawing.view import View, grasp_view
from viz.page.meshcat_scene import rounded

_LEAD, _TAIL = 0.14, 0.06  # of the whole duration: a close-up before and after a capture
_TOGETHER = 0.02  # of it: captures that share a close-up
_TURNING = 0.5
"""Fraction of the shorter of two shots in which the camera moves between them; as in ``camera.js``."""

_APART, _DRIFT_SHOTS = 2.0, 8
"""Ratio of the motion's box to the initial one from which a drift is divided into shots, and their number."""


def shots(
    result: Result, scene: Scene, motion: BodyMotion, view: View, box: tuple[Array, Array]
) -> list[dict[str, Any]]:
    """Shots in order: start time ``time`` [s], visible ``points`` [m], and direction ``towards`` the viewer.

    Without a capture the list is empty, and a single view shows everything; if bodies drift far apart,
    a few shots of equal length show what is there at the time.

    Args:
        result, scene, motion: Result, its scene and its motion.
        view: View of the whole scene.
        box: Lower and upper corner (3,) [m] of all visible points.
    """
    time, names = motion.time, list(result.array("grasp"))
    captures = sorted(
        (e["time_s"], names.index(e["who"]))
        for e in result.summary.get("events", ())
        if e["kind"] == "captured"
    )
    if len(time) < 3 or scene.target is None:
        return []
    if not captures and np.linalg.norm(box[1] - box[0]) < _APART * _diagonal(motion, 0, *box):
        return []
    # captures at almost the same time share a close-up; between others the camera changes halfway
    groups = [captures[:1]] if captures else []
    for before, capture in pairwise(captures):
        if capture[0] - before[0] < _TOGETHER * time[-1]:
            groups[-1].append(capture)
        else:
            groups.append([capture])
    edges = [0.0]
    for k, group in enumerate(groups):
        following = groups[k + 1][0][0] if k + 1 < len(groups) else np.inf
        begin = max(edges[-1], group[0][0] - _LEAD * time[-1])
        edges += [begin, min(time[-1], group[-1][0] + _TAIL * time[-1], (group[-1][0] + following) / 2)]
    instants = [*edges, float(time[-1])] if groups else np.linspace(0.0, time[-1], _DRIFT_SHOTS + 1).tolist()
    lasts = np.diff(instants)
    shot_list = []
    for k, (begin, end) in enumerate(pairwise(instants)):
        if end <= begin:
            continue
        shot_view = view
        if groups and k % 2 and not scene.planar:
            group = groups[k // 2]
            # tips and points of the grasps, from halfway through the approach to the close-up's end
            chosen = [grasp for _, grasp in group]
            tips = [scene.scenario.grasps[names[grasp]].tip for grasp in chosen]
            points = result.data.tip_position.sel(tip=tips).values[motion.rows]
            held = replace(motion, mates=np.concatenate([motion.mates[:, chosen], points], axis=1))
            instants_seen = np.array([(begin + group[0][0]) / 2, group[0][0], (group[0][0] + end) / 2, end])
            rows = np.searchsorted(time, instants_seen).clip(0, len(time) - 1)
            shot_view = grasp_view(held, rows.tolist(), view)
        # A camera between two shots shows what both of them show (exactly in a parallel projection): so each
        # shot also holds all bodies while the camera comes from the one before it and goes to the next.
        neighbours = [lasts[j] if 0 <= j < len(lasts) else 0.0 for j in (k - 1, k + 1)]
        reached = [
            begin - _TURNING * min(neighbours[0], lasts[k]),
            end + _TURNING * min(neighbours[1], lasts[k]),
        ]
        first, last = np.searchsorted(time, reached).clip(0, len(time) - 1)
        mates = motion.mates[first : last + 1].reshape(-1, 3)
        points = extremes(_between(motion, first, last), *box)
        if len(mates):
            points = np.vstack([points, mates.min(axis=0), mates.max(axis=0)])
        shot_list.append(
            {
                "time": float(begin),
                "points": [rounded(p) for p in points],
                "towards": rounded(shot_view.towards),
            }
        )
    return shot_list


def box_corners(middle: Array, half: Array) -> Array:
    """Corners (8, 3) of a box with this middle and half these edges (3,), m."""
    corners = np.meshgrid(*np.stack([middle - half, middle + half]).T)
    return np.stack(corners).reshape(3, -1).T


def _diagonal(motion: BodyMotion, frame: int, low: Array, high: Array) -> float:
    """Diagonal of a box around the bodies in a frame, m."""
    return float(np.linalg.norm(np.ptp(extremes(_between(motion, frame, frame), low, high), axis=0)))


def _between(motion: BodyMotion, first: int, last: int) -> BodyMotion:
    """A motion from one frame to another."""
    part = slice(first, last + 1)
    return replace(
        motion, time=motion.time[part], position=motion.position[part], quaternion=motion.quaternion[part]
    )
