"""Centres of mass, and the momenta drawn at them, over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.arrays import Array
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.motion import BodyMotion
from viz.drawing.placements import JointPlacements
from viz.page.meshcat_scene import packed

_ROUNDING = 1e-6
NO_MASSES: dict[str, Any] = {"centres": "", "momenta": "", "count": 0, "greatest": 0.0}
"""Data of a scene in which nothing moves, or that has not been simulated yet."""


def centres_of_mass(scene: Scene, joints: JointPlacements) -> tuple[Array, Array]:
    """Centres of mass of what moves.

    Args:
        scene: The scene.
        joints: Where they are (nt).

    Returns:
        centres: Of each body's moving links, world (nt, bodies, 3), m; not a number for a body of which
            nothing moves.
        masses: Of them (bodies,), kg.
    """
    model, times = scene.model, len(joints.origin)
    tops = [[joint for joint in body.subtree if joint] for body in scene.bodies]
    masses = np.array([sum(model.inertias[joint].mass for joint in tree) for tree in tops])
    centres = np.full((times, len(tops), 3), np.nan)
    for k, tree in enumerate(tops):
        if masses[k] > 0:
            parts = [(model.inertias[j].mass, joints.points(j, model.inertias[j].lever)) for j in tree]
            centres[:, k] = sum(mass * points for mass, points in parts) / masses[k]
    return centres, masses


def mass_data(result: Result, scene: Scene, motion: BodyMotion) -> dict[str, Any]:
    """Centres of mass and linear momenta of moving bodies, then of all together, at times of a motion.

    Returns:
        dict: ``centres`` [m] and ``momenta`` [N s], packed (nt, k + 1, 3); ``count``, which is k + 1; and
            ``greatest`` [N s], of the momenta (of a diverged result before its last instants), 0 if it is
            rounding.
    """
    rows = motion.rows
    centres, masses = centres_of_mass(scene, motion.joints)
    moving = masses > 0
    if not moving.any():
        return NO_MASSES
    centres, masses = centres[:, moving], masses[moving]
    centre = np.einsum("tkc,k->tc", centres, masses) / masses.sum()
    body_momenta = result.array("body_momentum_linear")[rows][:, moving]
    momenta = np.concatenate([body_momenta, result.array("momentum_linear")[rows][:, None]], axis=1)
    count = len(rows) if result.completed else max(1, int(0.8 * len(rows)))
    greatest = float(np.linalg.norm(momenta[:count], axis=-1).max(initial=0.0))
    # of a robot that holds nothing: rounding, beside what moves inside it
    inner = float(np.sqrt(2 * masses.sum() * result.array("energy_kinetic")[rows].max()))
    return {
        "centres": packed(np.concatenate([centres, centre[:, None]], axis=1)),
        "momenta": packed(momenta),
        "count": int(moving.sum()) + 1,
        "greatest": greatest if greatest > _ROUNDING * inner else 0.0,
    }
