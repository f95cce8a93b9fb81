"""Initial configuration and velocity, bases placed by closing their grasps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.errors import ScenarioError
from spacerobot.scene.scene import Array, SceneBody, SceneGrasp


def initial_state(
    model: Any, bodies: Sequence[SceneBody], grasps: Sequence[SceneGrasp], *, source: Path | None
) -> tuple[Array, Array]:
    """Configuration (nq,) and velocity (nv,) that the scenario describes.

    Raises
    ------
    ScenarioError
        If bases wait for each other to be placed.
    """
    q, v = pin.neutral(model), np.zeros(model.nv)
    for body in bodies:
        _set_joints(model, body, q, v)
        _set_base(model, body, np.array(body.base.position, dtype=float), q, v)
    for body, own, other in closing_order(bodies, grasps, source=source):
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        gap = data.oMf[other].translation - data.oMf[own].translation
        if body.base.joint == "planar":
            gap[2] = 0.0
        _set_base(model, body, np.array(body.base.position) + gap, q, v)
    return q, v


def closing_order(
    bodies: Sequence[SceneBody], grasps: Sequence[SceneGrasp], *, source: Path | None = None
) -> list[tuple[SceneBody, int, int]]:
    """Bodies placed by closing a grasp, in order, each with its own frame and the frame it must meet.

    Raises
    ------
    ScenarioError
        If bases wait for each other, or a grasp does not involve the body it shall place.
    """
    by_name = {grasp.name: grasp for grasp in grasps}
    waiting = [body for body in bodies if body.base.close_grasp is not None]
    order = []
    while waiting:
        names = {body.name for body in waiting}
        ready = [body for body in waiting if _partner(body, by_name, source)[0] not in names]
        if not ready:
            paths = " and ".join(f"{body.path}.base.close_grasp" for body in waiting)
            raise ScenarioError(f"{paths} wait for each other; give one of them a position", source=source)
        for body in ready:
            order.append((body, *_partner(body, by_name, source)[1:]))
            waiting.remove(body)
    return order


def _partner(body: SceneBody, grasps: dict[str, SceneGrasp], source: Path | None) -> tuple[str, int, int]:
    """Name of the other body of the grasp, own frame, other frame."""
    grasp = grasps[body.base.close_grasp or ""]
    if body.name == "target":
        return grasp.tip.body.name, grasp.frame, grasp.tip.frame
    if grasp.tip.body.name != body.name:
        raise ScenarioError(
            f"grasp {grasp.name!r} holds {grasp.tip.label!r}, not a tip of {body.name!r}",
            source=source,
            where=f"{body.path}.base.close_grasp",
        )
    return "target", grasp.tip.frame, grasp.frame


def _set_base(model: Any, body: SceneBody, position: Array, q: Array, v: Array) -> None:
    if not body.root_joint:
        return
    joint = model.joints[body.root_joint]
    rotation = pin.rpy.rpyToMatrix(np.radians(body.base.rotation_deg))
    linear = rotation.T @ np.array(body.base.velocity)
    angular = rotation.T @ np.radians(body.base.spin_deg)
    if body.base.joint == "planar":
        yaw = np.radians(body.base.rotation_deg[2])
        q[joint.idx_q : joint.idx_q + 4] = [position[0], position[1], np.cos(yaw), np.sin(yaw)]
        v[joint.idx_v : joint.idx_v + 3] = [linear[0], linear[1], angular[2]]
    else:
        q[joint.idx_q : joint.idx_q + 7] = [*position, *_quaternion(np.radians(body.base.rotation_deg))]
        v[joint.idx_v : joint.idx_v + 6] = np.concatenate([linear, angular])


def _quaternion(rpy: Array) -> Array:
    """Quaternion x, y, z, w (4,) of roll, pitch, yaw [rad]; its sign follows the angles without a jump."""
    roll, pitch, yaw = (
        pin.Quaternion(pin.AngleAxis(float(angle), axis)) for angle, axis in zip(rpy, np.eye(3), strict=True)
    )
    quaternion: Array = (yaw * pitch * roll).coeffs()
    return quaternion


def _set_joints(model: Any, body: SceneBody, q: Array, v: Array) -> None:
    begins = {}
    for name, joint in body.config.joints.items():
        position = np.radians(joint.angle_deg or 0.0) + (joint.offset or 0.0)
        rate = np.radians(joint.rate_deg or 0.0) + (joint.speed or 0.0)
        begins[model.getJointId(f"{body.name}/{name}")] = (position, rate)
    for tie in body.ties:
        position, rate = begins[tie.leader]
        begins[tie.joint] = (tie.multiplier * position + tie.offset, tie.multiplier * rate)
    for index, (angle, rate) in begins.items():
        pin_joint = model.joints[index]
        v[pin_joint.idx_v] = rate
        if pin_joint.nq == 2:
            q[pin_joint.idx_q : pin_joint.idx_q + 2] = [np.cos(angle), np.sin(angle)]
        else:
            q[pin_joint.idx_q] = angle
