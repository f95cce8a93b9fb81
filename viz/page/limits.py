"""Limits that the page's curves have: of joints, by the URDFs, of grasps and of wheels, by the scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from spacerobot.description.parts import UrdfJoint
from spacerobot.scenario import Robot
from spacerobot.scene import Scene

Limits = Mapping[tuple[str, str], tuple[float | None, float | None]]
"""Least and greatest allowed value by quantity and signal, in the quantity's unit; None where it is open."""


def drawn_limits(scene: Scene) -> Limits:
    """Limits of all signals of a scene that have any."""
    return {**joint_limits(scene), **_grasp_limits(scene), **_wheel_limits(scene)}


def _grasp_limits(scene: Scene) -> Limits:
    """Capture envelopes, and forces at which grasps break away."""
    found: dict[tuple[str, str], tuple[float | None, float | None]] = {}
    for grasp in scene.grasps:
        capture, release = grasp.config.capture, grasp.config.release
        named = {
            "gap of grips": capture and capture.distance and capture.distance * 1e3,
            "misalignment of grips": capture and capture.misalignment_deg,
            "grip force": release and release.force,
        }
        found |= {(title, grasp.name): (None, limit) for title, limit in named.items() if limit}
    return found


def _wheel_limits(scene: Scene) -> Limits:
    """Greatest speeds and motor torques of reaction wheels."""
    found: dict[tuple[str, str], tuple[float | None, float | None]] = {}
    robots = ((body.name, body.config) for body in scene.bodies if isinstance(body.config, Robot))
    for robot, where, actuator in (
        (name, *driven) for name, config in robots for driven in config.driven_by()
    ):
        storage = actuator.momentum_storage()
        if storage is None:
            continue
        for i in range(len(storage.speeds)):
            name = f"{robot}/{where.rpartition('.')[2]}.{i}"
            for title, limit in (("speed", storage.speed_limit), ("torque", storage.torque_limit)):
                if limit is not None:
                    found[f"wheel {title}", name] = (-limit, limit)
    return found


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
