"""Limits drawn with the page's curves: of joints from the URDFs, of grasps and wheels from the scenario."""

from __future__ import annotations

import numpy as np

from spacerobot.common.tables import unit_scale
from spacerobot.scenario import Robot
from spacerobot.scene import Scene

Limits = dict[tuple[str, str], tuple[float | None, float | None]]
"""Lower and upper limit by quantity and signal, in the quantity's unit; None if unlimited."""


def drawn_limits(scene: Scene) -> Limits:
    """Limits of all limited signals of a scene."""
    limits = joint_limits(scene)
    # capture envelopes, and forces at which grasps break away
    for grasp in scene.grasps:
        capture, release = grasp.config.capture, grasp.config.release
        envelope_limits = {
            "gap of grips": capture and capture.distance and capture.distance * 1e3,
            "misalignment of grips": capture and capture.misalignment_deg,
            "grip force": release and release.force,
        }
        limits |= {(title, grasp.name): (None, limit) for title, limit in envelope_limits.items() if limit}
    # maximum speeds and motor torques of reaction wheels
    robots = ((body.name, body.config) for body in scene.bodies if isinstance(body.config, Robot))
    for robot, where, actuator in (
        (name, *driven) for name, robot_limits in robots for driven in robot_limits.driven_by()
    ):
        storage = actuator.momentum_storage()
        if storage is None:
            continue
        for i in range(len(storage.speeds)):
            name = f"{robot}/{where.rpartition('.')[2]}.{i}"
            rpm = unit_scale("rad/s", "wheel_speed")[0]
            for title, factor, limit in (
                ("speed", rpm, storage.speed_limit),
                ("torque", 1.0, storage.torque_limit),
            ):
                if limit is not None:
                    limits[f"wheel {title}", name] = (-factor * limit, factor * limit)
    return limits


def joint_limits(scene: Scene) -> Limits:
    """Limits of angles or travels, rates and torques or forces of all joints that have any."""
    limits_by_joint = {}
    for body in scene.bodies:
        for joint in body.description.joints:
            turns = joint.kind != "prismatic"
            factor = np.degrees(1.0) if turns else 1e3
            names = ("angle", "rate", "torque") if turns else ("travel", "speed", "force")
            # an effort or velocity of 0 in a URDF means that none was stated
            velocity, effort = (joint.velocity or np.inf) * factor, joint.effort or np.inf
            limits = ((joint.lower * factor, joint.upper * factor), (-velocity, velocity), (-effort, effort))
            for name, ends in zip(names, limits, strict=True):
                if np.isfinite(ends).any():
                    low, high = (float(end) if np.isfinite(end) else None for end in ends)
                    limits_by_joint[f"joint {name}", f"{body.name}/{joint.name}"] = (low, high)
    return limits_by_joint
