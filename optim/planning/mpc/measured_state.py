"""State of a scene as the robots' sensors measure it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.elements.goal import TipGoal
from spacerobot.scenario.plan import PlanSection
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneTip


def sensors_of(scene: Scene) -> dict[str, Sensors]:
    """Sensors of each robot, as they are in the first phase where there are phases."""
    scenario = scene.scenario
    first = scenario.during(next(iter(scenario.phases))) if scenario.phases else scenario
    return {name: robot.sensors or Sensors() for name, robot in first.robots.items()}


def measured_state(scene: Scene, plan: PlanSection, sensors: Mapping[str, Sensors], state: Array) -> Array:
    """State of a scene with the errors of the robots' sensors.

    Joints and floating bases are read by their robots' sensors. Of the target, the mating frames of the goals
    are seen relative to where the tips seem to be; where several see it, it is taken to be in the middle.

    Parameters
    ----------
    scene, plan
        The scene, and its section.
    sensors
        Of each robot.
    state
        Begins with the true configuration and velocity (nq + nv, or more).

    Returns
    -------
    numpy.ndarray
        Configuration and velocity (nq + nv,).
    """
    model, nq = scene.model, scene.model.nq
    q, v = np.array(state[:nq]), np.array(state[nq : nq + model.nv])
    truth = _moved(model, q, v)
    for body in scene.robots:
        _read_joints(scene, body, sensors[body.name], q, v)
        _read_base(scene, body, sensors[body.name], q, v)
    own, tips = _moved(model, q, v), {tip.label: tip for tip in scene.tips}
    seen = [
        _seen(scene, (tips[goal.tip], goal.follows), sensors[tips[goal.tip].body.name], truth, own)
        for goal in plan.goals.values()
        if isinstance(goal, TipGoal) and goal.follows
    ]
    if seen and scene.target is not None:
        shift, turn, velocity, spin = np.mean(seen, axis=0)
        root = truth.oMi[scene.target.root_joint]
        rotation = pin.exp3(turn) @ root.rotation
        _place(scene, scene.target, q, v, (root.translation + shift, rotation, velocity, spin))
    return np.concatenate([q, v])


def _place(scene: Scene, body: SceneBody, q: Array, v: Array, pose: tuple[Array, ...]) -> None:
    """Set position and rotation of a body's root, and velocity and spin in its own axes, in place."""
    position, rotation, velocity, spin = pose
    joint, axes = scene.model.joints[body.root_joint], list(scene.translation_axes)
    turned = rotation[:2, 0] if scene.planar else pin.Quaternion(rotation).coeffs()
    q[joint.idx_q : joint.idx_q + joint.nq] = np.concatenate([position[axes], turned])
    turns = spin[list(scene.rotation_axes)]
    v[joint.idx_v : joint.idx_v + joint.nv] = np.concatenate([velocity[axes], turns])


def _read_base(scene: Scene, body: SceneBody, sensors: Sensors, q: Array, v: Array) -> None:
    """Pose and motion of a floating base as they are read, in place."""
    signals = ("base_position", "base_orientation", "base_velocity", "base_spin")
    if not body.root_joint or all(sensors[signal].is_ideal for signal in signals):
        return
    place, turn, linear, angular = (sensors[signal] for signal in signals)
    along, about = scene.translation_axes, scene.rotation_axes
    data = _moved(scene.model, q, v)
    root, motion = data.oMi[body.root_joint], data.v[body.root_joint]
    rotation = pin.exp3(_shown(turn, pin.log3(root.rotation), about))
    velocity = rotation.T @ _shown(linear, root.rotation @ motion.linear, along)
    spin = rotation.T @ _shown(angular, root.rotation @ motion.angular, about)
    _place(scene, body, q, v, (_shown(place, root.translation, along), rotation, velocity, spin))


def _moved(model: Any, q: Array, v: Array) -> Any:
    """Pinocchio's data of a configuration and velocity."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    return data


def _seen(scene: Scene, who: tuple[SceneTip, str], sensors: Sensors, truth: Any, own: Any) -> Array:
    """Where the target's root seems to be, by what a tip sees of a mating frame (4, 3).

    Shift [m] and turn [rad] in world axes, velocity [m/s] and spin [rad/s] in the root's; ``truth`` is how
    all is, ``own`` how it is by the robots' knowledge of themselves.
    """
    model, (tip, frame), along, about = scene.model, who, scene.translation_axes, scene.rotation_axes
    mate = model.getFrameId(f"target/{frame}", pin.FrameType.BODY)
    motion = pin.getFrameVelocity(model, truth, mate, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    there, here, known = truth.oMf[mate], truth.oMf[tip.frame], own.oMf[tip.frame]
    assert scene.target is not None
    root = truth.oMi[scene.target.root_joint]
    turn = _shown(sensors.target_orientation, pin.log3(there.rotation @ here.rotation.T), about)
    error = pin.exp3(turn) @ known.rotation @ there.rotation.T
    away = _shown(sensors.target_position, there.translation - here.translation, along)
    velocity = _shown(sensors.target_velocity, motion.linear, along)
    spin = _shown(sensors.target_spin, motion.angular, about)
    lever = error @ (there.translation - root.translation)
    back = (error @ root.rotation).T
    shift = known.translation + away - lever - root.translation
    return np.array([shift, pin.log3(error), back @ (velocity - np.cross(spin, lever)), back @ spin])


def _read_joints(scene: Scene, body: SceneBody, sensors: Sensors, q: Array, v: Array) -> None:
    """Joint positions and rates as they are read, in place."""
    for joint in body.driven_joints:
        own = scene.model.joints[joint]
        at = own.idx_q
        if own.nq == 2:
            angle = _shown(sensors.joint_position, np.arctan2(q[at + 1], q[at]))
            q[at : at + 2] = np.cos(angle), np.sin(angle)
        else:
            q[at] = _shown(sensors.joint_position, q[at])
        v[own.idx_v] = _shown(sensors.joint_rate, v[own.idx_v])


def _shown(sensor: Any, value: Any, axes: tuple[int, ...] | None = None) -> Any:
    """Reading of a sensor, with errors along some axes alone."""
    error = sensor.offset + (sensor.scale - 1) * value
    return value + (error if axes is None else error * np.isin(np.arange(3), axes))
