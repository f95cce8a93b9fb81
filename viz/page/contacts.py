"""Page data of contacts, grasps and plumes: forces, closed grasps, and times of capture."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from viz.drawing.motion import Rows
from viz.page.meshcat_scene import packed

_CAPTURED = 2  # a grasp's state
NO_CONTACTS: dict[str, Any] = {"count": 0, "forces": "", "points": ""}
NO_PLUMES: dict[str, Any] = {"count": 0, "forces": "", "points": "", "greatest": 0.0}
NO_GRIPS: dict[str, Any] = {"held": "", "captures": [], "impulses": [], "greatest": 0.0}
"""Data without contacts, thrusters and grasps."""


def contact_data(result: Result, rows: Rows) -> dict[str, Any]:
    """Contacts near rows of a result: ``count``, ``forces`` [N] and ``points`` [m], packed (nt, count, 3)."""
    data = result.data
    if "contact" not in data.dims:
        return NO_CONTACTS
    forces, points = strongest(result.array("contact_force"), result.array("contact_point"), rows)
    return {"count": data.sizes["contact"], "forces": packed(forces), "points": packed(points)}


def strongest(forces: Array, points: Array, rows: Rows) -> tuple[Array, Array]:
    """Forces and points of action (nt, n, 3): the maximum among the samples nearest to each row.

    Forces may be shorter than the time between frames.
    """
    edges = [0, *((rows[1:] + rows[:-1]) // 2 + 1), len(forces)]
    size = np.linalg.norm(forces, axis=-1)
    peak_rows = np.array([begin + size[begin:end].argmax(axis=0) for begin, end in pairwise(edges)])
    places = np.arange(forces.shape[1])
    return forces[peak_rows, places], points[peak_rows, places]


def plume_data(result: Result, rows: Rows) -> dict[str, Any]:
    """Thrusters near rows of a result: ``count``, ``forces`` [N] and ``points`` [m], packed (nt, count, 3).

    ``greatest`` is the largest force [N]. Pulses may be shorter than the time between frames.
    """
    if "thruster" not in result.data.dims:
        return NO_PLUMES
    forces, points = strongest(result.array("thruster_force"), result.array("thruster_position"), rows)
    greatest = float(np.linalg.norm(forces, axis=-1).max(initial=0.0))
    plumes = {"forces": packed(forces), "points": packed(points), "greatest": greatest}
    return {"count": result.data.sizes["thruster"], **plumes}


def grip_data(result: Result, rows: Rows) -> dict[str, Any]:
    """Page data of grasps: ``held``, packed (nt, grasps), 1 or 0, and times [s] of their ``captures``.

    ``impulses`` of impacts on the target are (time [s], x, y, z [N s]) for each grasp, empty if no rigid
    grasp opens or closes; ``greatest`` is the largest [N s].
    """
    data, events = result.data, result.summary.get("events", ())
    is_held = np.ones((len(rows), data.sizes["grasp"]))
    if "grasp_state" in data:  # not a number for one that is always closed
        state = result.array("grasp_state")[rows]
        is_held = np.where(np.isnan(state), 1.0, state == _CAPTURED)
    captures = [
        [e["time_s"] for e in events if (e["kind"], e["who"]) == ("captured", name)]
        for name in result.array("grasp")
    ]
    rigid = any(grasp.is_rigid for grasp in result.scenario.grasps.values())
    impulses = [
        [[e["time_s"], *e["impulses_n_s"][name]] for e in events if name in e.get("impulses_n_s", ())]
        for name in (result.array("grasp") if rigid and "grasp_impulse" in data else ())
    ]
    greatest = max((float(np.linalg.norm(one[1:])) for grip in impulses for one in grip), default=0.0)
    return {"held": packed(is_held), "captures": captures, "impulses": impulses, "greatest": greatest}
