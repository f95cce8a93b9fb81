"""The planet of an orbit for the page: where it is, seen from the world's origin."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.result import Result
from viz.drawing.motion import Rows
from viz.page.meshcat_scene import packed


def planet_data(result: Result, rows: Rows) -> dict[str, Any] | None:
    """Radius [m] of the planet, and at rows its centre's distance [m] and direction; None without an orbit.

    The centre is at ``-distance * (cos angle, sin angle, 0)`` in world axes; ``angle`` [rad] is 0 at the
    start (see :class:`spacerobot.elements.environments.orbit.OrbitState`). Both are packed (nt,).
    """
    found = [e.planet_radius for e in result.scenario.environment.values() if hasattr(e, "planet_radius")]
    if not found or "orbit_radius" not in result.data:
        return None
    anomaly = np.unwrap(result.array("orbit_anomaly"))
    return {
        "radius": found[0],
        "distance": packed(result.array("orbit_radius")[rows]),
        "angle": packed((anomaly - anomaly[0])[rows]),
    }
