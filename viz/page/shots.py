"""Shots of the camera over a motion: the approach, each capture from near, and the whole afterwards."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from spacerobot.arrays import Array
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.motion import BodyMotion, extremes, only
from viz.drawing.view import View, grasp_view
from viz.page.meshcat_scene import rounded

_LEAD, _TAIL = 0.14, 0.06  # of the whole duration: a close-up before and after a capture
_TOGETHER = 0.02  # of it: captures that share a close-up
_NEAR = 0.4  # half of a close-up, as a share of the smaller one's size of target and robot
_MOST = 0.2  # at most, as a share of the size of all that is shown then
_LEAST = 0.07  # at least, as a share of the scene's over the whole motion


def shots(
    result: Result, scene: Scene, motion: BodyMotion, view: View, box: tuple[Array, Array]
) -> list[dict[str, Any]]:
    """Shots in time: first instant ``time`` [s], ``points`` to be seen [m] and ``towards`` the eye.

    None where nothing is captured: then one view shows everything.

    Parameters
    ----------
    result, scene, motion
        What is shown, and how it moves.
    view
        From where it is seen as a whole.
    box
        Least and greatest corner (3,) of all that is shown, m.
    """
    time, names = motion.time, list(result.array("grasp"))
    captures = sorted(
        (e["time_s"], names.index(e["who"]))
        for e in result.summary.get("events", ())
        if e["kind"] == "captured"
    )
    if not captures or len(time) < 3 or scene.target is None:
        return []
    # captures at almost the same time share a close-up; between others the camera changes halfway
    groups = [[captures[0]]]
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
    found = []
    for k, (begin, end) in enumerate(pairwise([*edges, float(time[-1])])):
        first, last = np.searchsorted(time, [begin, end]).clip(0, len(time) - 1)
        if end <= begin:
            continue
        if k % 2 == 0:
            points, seen = extremes(_between(motion, first, last), *box), view
        else:
            group = groups[k // 2]
            row = int(np.searchsorted(time, group[0][0]).clip(0, len(time) - 1))
            held = replace(motion, mates=motion.mates[:, [grasp for _, grasp in group]])
            tips = (scene.scenario.grasps[names[grasp]].tip for _, grasp in group)
            holding = {tip.partition("/")[0] for tip in tips}
            smallest = min(_size(only(motion, body), row, box) for body in (scene.target.name, *holding))
            reach = min(_NEAR * smallest, _MOST * _size(motion, row, box))
            # corners (8, 3) of a box around the mating frames, that reaches far enough beyond their middle
            mates = held.mates[row]
            beyond = max(reach, _LEAST * float(np.linalg.norm(box[1] - box[0])))
            middle = (mates.min(axis=0) + mates.max(axis=0)) / 2
            half = np.maximum(np.ptp(mates, axis=0) / 2 * 1.3, beyond)
            points = box_corners(middle, half)
            seen = view if scene.planar else grasp_view(held, row, view)
        found.append(
            {"time": float(begin), "points": [rounded(p) for p in points], "towards": rounded(seen.towards)}
        )
    return found


def box_corners(middle: Array, half: Array) -> Array:
    """Corners (8, 3) of a box with this middle and half these edges (3,), m."""
    corners = np.meshgrid(*np.stack([middle - half, middle + half]).T)
    return np.stack(corners).reshape(3, -1).T


def _size(motion: BodyMotion, row: int, box: tuple[Array, Array]) -> float:
    """Longest side of a box around what is seen at a frame, m."""
    return float(np.ptp(extremes(_between(motion, row, row), *box), axis=0).max())


def _between(motion: BodyMotion, first: int, last: int) -> BodyMotion:
    """A motion from one frame to another."""
    part = slice(first, last + 1)
    return replace(
        motion, time=motion.time[part], position=motion.position[part], quaternion=motion.quaternion[part]
    )
