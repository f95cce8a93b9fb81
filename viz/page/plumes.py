"""Plumes of thrusters for the page: forces on the bases and where they act."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.result import Result
from viz.drawing.motion import Rows
from viz.page.contacts import strongest
from viz.page.meshcat_scene import packed


def plume_data(result: Result, rows: Rows) -> dict[str, Any]:
    """Thrusters near rows of a result: ``count``, ``forces`` [N] and ``points`` [m], packed (nt, count, 3).

    ``greatest`` is the largest force [N]. A pulse may be shorter than the time between frames.
    """
    data = result.data
    if "thruster" not in data.dims:
        return no_plumes()
    forces, points = strongest(result.array("thruster_force"), result.array("thruster_position"), rows)
    return {
        "count": data.sizes["thruster"],
        "forces": packed(forces),
        "points": packed(points),
        "greatest": float(np.linalg.norm(forces, axis=-1).max(initial=0.0)),
    }


def no_plumes() -> dict[str, Any]:
    """The same where there are no thrusters."""
    return {"count": 0, "forces": "", "points": "", "greatest": 0.0}
