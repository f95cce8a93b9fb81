"""Centres of mass over time, and the momenta drawn at them."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.motion import BodyMotion
from viz.drawing.placements import JointPlacements
from viz.page.meshcat_scene import packed

_ROUNDING = 1e-6
NO_MASSES: dict[str, Any] = {"centres": "", "momenta": "", "count": 0, "greatest": 0.0}
"""Data of a scene without moving bodies, or without a simulation."""


def centres_of_mass(scene: Scene, joints: JointPlacements) -> tuple[Array, Array]:
    """Centres of mass of moving bodies.

    Args:
        scene: The scene.
        joints: Placements of the joints (nt).

    Returns:
        centres: Centre of mass of each body's moving links, world (nt, bodies, 3) [m]; NaN for a body without
            moving links.
        masses: Masses of the moving links (bodies,) [kg].
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
    """Centres of mass and linear momenta of each moving body, and of all bodies, at the times of a motion.

    Returns:
        dict: ``centres`` [m] and ``momenta`` [N s], packed (nt, k + 1, 3) with k bodies and the total;
            ``count``, which is k + 1; ``greatest``, the largest momentum [N s] (for a diverged result before
            its last instants), or 0 if it is only rounding.
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
    # total momentum of a free robot is rounding compared with the momenta of its moving parts
    inner = float(np.sqrt(2 * masses.sum() * result.array("energy_kinetic")[rows].max()))
    return {
        "centres": packed(np.concatenate([centres, centre[:, None]], axis=1)),
        "momenta": packed(momenta),
        "count": int(moving.sum()) + 1,
        "greatest": greatest if greatest > _ROUNDING * inner else 0.0,
    }
