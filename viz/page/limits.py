"""Limits of joints, as the URDFs tell them, for the page's curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from spacerobot.description.parts import UrdfJoint
from spacerobot.scene import Scene

Limits = Mapping[tuple[str, str], tuple[float | None, float | None]]
"""Least and greatest allowed value by quantity and signal, in the quantity's unit; None where it is open."""


def joint_limits(scene: Scene) -> Limits:
    """Limits of angles or travels, rates and torques or forces of all joints that have any."""
    found = {}
    for body in scene.bodies:
        for joint in body.description.joints:
            for title, low, high in _limits(joint):
                if np.isfinite([low, high]).any():
                    found[title, f"{body.name}/{joint.name}"] = (_plain(low), _plain(high))
    return found


def _limits(joint: UrdfJoint) -> Iterator[tuple[str, float, float]]:
    turns = joint.kind != "prismatic"
    factor = np.degrees(1.0) if turns else 1e3
    names = ("angle", "rate", "torque") if turns else ("travel", "speed", "force")
    # an effort or velocity of 0 in a URDF says that nobody gave one
    velocity, effort = joint.velocity or np.inf, joint.effort or np.inf
    yield f"joint {names[0]}", joint.lower * factor, joint.upper * factor
    yield f"joint {names[1]}", -velocity * factor, velocity * factor
    yield f"joint {names[2]}", -effort, effort


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
