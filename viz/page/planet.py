"""Planet of an orbit for the page: direction, distance and size from the world's origin."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.motion import Rows
from viz.drawing.view import View, oblique
from viz.page.meshcat_scene import packed

_OFF_LIMB_DEG = 6.0
"""Angle between the middle of a picture and the planet's limb."""


def planet_data(result: Result, rows: Rows) -> dict[str, Any] | None:
    """Radius [m] of the planet, and at rows its centre's distance [m] and direction; None without an orbit.

    The centre is at ``-distance * (cos angle, sin angle, 0)`` in world axes; ``angle`` [rad] is 0 at the
    start (see :class:`spacerobot.elements.environments.orbit.OrbitState`). Both are packed (nt,).
    """
    radii = [e.planet_radius for e in result.scenario.environment.values() if hasattr(e, "planet_radius")]
    if not radii or "orbit_radius" not in result.data:
        return None
    anomaly = np.unwrap(result.array("orbit_anomaly"))
    return {
        "radius": radii[0],
        "distance": packed(result.array("orbit_radius")[rows]),
        "angle": packed((anomaly - anomaly[0])[rows]),
    }


def has_backdrop(scene: Scene) -> bool:
    """Whether an Earth is drawn as a backdrop: in space, if no environment defines the planet's position."""
    scenario = scene.scenario
    orbits = any(hasattr(element, "planet_radius") for element in scenario.environment.values())
    return not (scene.planar or orbits or any(scenario.gravity))


def limb_view(view: View, planet: dict[str, Any] | None) -> View:
    """View with the same elevation, rotated about z by the smallest angle that shows the planet's limb.

    At the start the planet's centre lies in the direction -x and its disc has the half angle
    ``arcsin(radius / distance)``. A direction d of sight with the angle g to -x looks at the limb, a little
    off the middle of the picture, where ``g`` is that half angle and ``_OFF_LIMB_DEG``. On a high
    orbit, where no direction of the view's elevation has so small an angle, the view has the elevation ``g``.

    Args:
        view: View in which the arms are hidden least.
        planet: Data of :func:`planet_data`; None returns the view unchanged.
    """
    if planet is None:
        return view
    x, y, z = view.towards
    size = np.degrees(np.arcsin(min(1.0, planet["radius"] / float(planet["distance"][0]))))
    # d = -towards, so that cos g = d . (-x) is the first component of towards
    first = np.cos(np.radians(min(90.0, size + _OFF_LIMB_DEG))) / max(1e-9, np.hypot(x, y))
    if first > 1:
        return oblique(0.0, min(90.0, size + _OFF_LIMB_DEG))
    azimuth = np.degrees(np.arctan2(y, x))
    turns = [(sign * np.degrees(np.arccos(first)) - azimuth + 180) % 360 - 180 for sign in (1, -1)]
    return oblique(azimuth + min(turns, key=abs), np.degrees(np.arcsin(z)))
