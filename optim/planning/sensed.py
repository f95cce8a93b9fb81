"""Where a scene seems to be, as the robots' sensors show it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.elements.goal import TipGoal
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneTip


def sensed(scene: Scene, plan: Planning, state: Array) -> Array:
    """Configuration and velocity (nq + nv,) by the sensors, where the true ones are the first of a state.

    Joints are read by their robots' sensors. Of the target, the mating frames of the goals are seen relative
    to the tips; where several see it, it is taken to be in the middle. Bases know where they are, and the
    target's orientation is known, as it is to a ``rendezvous``.
    """
    nq, nv = scene.model.nq, scene.model.nv
    q, v = np.array(state[:nq]), np.array(state[nq : nq + nv])
    tips = {tip.label: tip for tip in scene.tips}
    seen = [
        _seen(scene, tips[goal.tip], goal.follows, q, v)
        for goal in plan.goals.values()
        if isinstance(goal, TipGoal) and goal.follows
    ]
    for body in scene.robots:
        _read_joints(scene, body, q, v)
    if seen and scene.target is not None:
        shift, velocity, spin = np.mean(seen, axis=0)
        joint, axes = scene.model.joints[scene.target.root_joint], list(scene.translation_axes)
        q[joint.idx_q : joint.idx_q + len(axes)] += shift[axes]
        turns = spin[list(scene.rotation_axes)]
        v[joint.idx_v : joint.idx_v + joint.nv] = np.concatenate([velocity[axes], turns])
    return np.concatenate([q, v])


def _seen(scene: Scene, tip: SceneTip, frame: str, q: Array, v: Array) -> Array:
    """How far off the target seems [m]; velocity [m/s] and spin [rad/s] of its root in own axes (3, 3)."""
    model, data, sensors = scene.model, scene.model.createData(), _sensors(tip.body)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    mate, world = (
        model.getFrameId(f"target/{frame}", pin.FrameType.BODY),
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )
    motion, place = pin.getFrameVelocity(model, data, mate, world), data.oMf[mate].translation
    away = place - data.oMf[tip.frame].translation
    velocity, spin = (
        _shown(sensors.target_velocity, motion.linear),
        _shown(sensors.target_spin, motion.angular),
    )
    assert scene.target is not None
    root = data.oMi[scene.target.root_joint]
    own = root.rotation.T @ (velocity - np.cross(spin, place - root.translation))
    return np.array([_shown(sensors.target_position, away) - away, own, root.rotation.T @ spin])


def _read_joints(scene: Scene, body: SceneBody, q: Array, v: Array) -> None:
    """Joint positions and rates as they are read, in place."""
    sensors = _sensors(body)
    for joint in body.driven_joints:
        own = scene.model.joints[joint]
        at = own.idx_q
        if own.nq == 2:
            angle = _shown(sensors.joint_position, np.arctan2(q[at + 1], q[at]))
            q[at : at + 2] = np.cos(angle), np.sin(angle)
        else:
            q[at] = _shown(sensors.joint_position, q[at])
        v[own.idx_v] = _shown(sensors.joint_rate, v[own.idx_v])


def _shown(sensor: Any, value: Any) -> Any:
    return sensor.offset + sensor.scale * value


def _sensors(body: SceneBody) -> Any:
    return body.config.sensors  # type: ignore[union-attr]
