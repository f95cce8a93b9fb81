"""Impulse from outside, summed over everything that acts from there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.scene import Scene
from tests.oracles.engine.actuation import Push
from tests.oracles.engine.kinematics import Kinematics, cross

IMPULSE = tuple(f"impulse.{kind}[{i}]" for kind in ("linear", "angular") for i in range(3))
"""Names of the states that hold it."""


def impulse_rate(pushes: Sequence[Push], planar: bool) -> Array:
    """Force and torque about the world's origin (6,)."""
    rate = np.zeros(6)
    for push in pushes:
        rate += np.concatenate([push.force, push.torque + cross(push.point, push.force)])
    return rate * np.array([1, 1, 0, 0, 0, 1]) if planar else rate


def on_bases(scene: Scene, kinematics: Kinematics, torque: Array) -> Iterator[Push]:
    """Wrenches of the generalized forces (nv,) that are delivered to floating bases."""
    for body in scene.bodies:
        if body.root_joint:
            joint, place = scene.model.joints[body.root_joint], kinematics.data.oMi[body.root_joint]
            own = torque[joint.idx_v : joint.idx_v + joint.nv]
            force, couple = own[:3], own[3:]
            if joint.nv == 3:
                force, couple = np.array([*own[:2], 0.0]), np.array([0.0, 0.0, own[2]])
            at = np.array(place.translation)
            yield Push(body.root_joint, place.rotation @ force, place.rotation @ couple, at)
