"""State of a scene as the robots' sensors and filters estimate it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.closedloop import OutputVariable
from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.controller import MPC_INPUT
from spacerobot.scenario.plan import PlanSection
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneGrasp, SceneTip

HELD = "held_"
"""Prefix of the names of readings that are estimates of a held object."""
Readings = Mapping[tuple[str, str], Array]
"""Values by signal and source (``rpr1/joint_1``, ``rpr1``, ``rpr1/tip``); absent for ideal sensors."""


def sensors_of(scene: Scene) -> dict[str, Sensors]:
    """Sensors of each robot, those of the first phase if there are phases."""
    scenario = scene.scenario
    first = scenario.during(next(iter(scenario.phases))) if scenario.phases else scenario
    return {name: robot.sensors or Sensors() for name, robot in first.robots.items()}


def readings_of(variables: Iterable[OutputVariable], outputs: Mapping[str, Array]) -> Readings:
    """Sensor readings among the outputs of a closed loop at one instant.

    Args:
        variables: Outputs of the closed loop, whose ``mpc`` controllers name the signals that they read.
        outputs: Values by the output's name, each (n,).
    """
    readings: dict[tuple[str, str], Array] = {}
    for one in variables:
        if one.name.startswith(MPC_INPUT) and one.name in outputs:
            rows = np.reshape(outputs[one.name], (len(one.labels), -1))
            signal = one.name.removeprefix(MPC_INPUT)
            readings |= {(signal, label): row for label, row in zip(one.labels, rows, strict=True)}
    return {key: value for key, value in readings.items() if np.isfinite(value).all()}


def measured_state(
    scene: Scene,
    plan: PlanSection,
    readings: Readings,
    state: Array,
    first: Array,
    held: Sequence[SceneGrasp] = (),
) -> Array:
    """State of a scene as the robots' sensors and filters estimate it.

    Joints and floating bases are read by their robots' sensors. Tip sensors measure the mating frames of the
    goals relative to the estimated tips; several estimates of the target are averaged. A held target moves
    with its tip.

    Args:
        scene, plan: The scene, and its plan section.
        readings: Sensor readings; the true value stands in for a signal that is missing.
        state: Vector that begins with the true configuration and velocity (nq + nv, or more).
        first: Configuration at the start (nq,), the reference of the measured attitudes.
        held: Grasps that hold the target rigidly.

    Returns:
        numpy.ndarray: Configuration and velocity (nq + nv,).
    """
    model, nq = scene.model, scene.model.nq
    q, v = np.array(state[:nq]), np.array(state[nq : nq + model.nv])
    start, truth = moved(model, first, np.zeros(model.nv)), moved(model, q, v)
    for body in scene.robots:
        for joint in body.driven_joints:
            joint_model, label = model.joints[joint], f"{body.name}/{body.joint_name(model, joint)}"
            if ("joint_position", label) in readings:
                (angle,) = readings["joint_position", label]
                value = [np.cos(angle), np.sin(angle)] if joint_model.nq == 2 else angle
                q[joint_model.idx_q : joint_model.idx_q + joint_model.nq] = value
            v[joint_model.idx_v] = readings.get(("joint_rate", label), v[[joint_model.idx_v]])[0]
        signals = ("base_position", "base_orientation", "base_velocity", "base_spin")
        if not body.root_joint or not any((signal, body.name) in readings for signal in signals):
            continue
        along, about = scene.translation_axes, scene.rotation_axes
        data, joint = moved(model, q, v), body.root_joint
        root, twist, first = data.oMi[joint], data.v[joint], start.oMi[joint].rotation
        true = (
            root.translation,
            pin.log3(root.rotation @ first.T),
            root.rotation @ twist.linear,
            root.rotation @ twist.angular,
        )
        place, turn, linear, angular = (
            _along(readings.get((signal, body.name)), value, axes)
            for signal, value, axes in zip(signals, true, (along, about, along, about), strict=True)
        )
        rotation = pin.exp3(turn) @ first
        _place(scene, body, q, v, (place, rotation, rotation.T @ linear, rotation.T @ angular))
    estimate, tips = moved(model, q, v), {tip.label: tip for tip in scene.tips}
    for grasp in held[:1]:
        assert scene.target is not None, "what is held is the target"
        tip = grasp.tip.frame
        grip = truth.oMf[tip].actInv(truth.oMi[scene.target.root_joint])
        twist = grip.actInv(pin.getFrameVelocity(model, estimate, tip, pin.ReferenceFrame.LOCAL))
        pose = estimate.oMf[tip] * grip
        _place(scene, scene.target, q, v, (pose.translation, pose.rotation, twist.linear, twist.angular))
        return np.concatenate([q, v])
    sightings = [
        _seen(scene, (tips[goal.mating[0]], goal.mating[1]), readings, (start, truth, estimate))
        for goal in plan.goals.values()
        if goal.mating
    ]
    if sightings and scene.target is not None:
        shift, turn, velocity, spin = np.mean(sightings, axis=0)
        root = truth.oMi[scene.target.root_joint]
        rotation = pin.exp3(turn) @ root.rotation
        _place(scene, scene.target, q, v, (root.translation + shift, rotation, velocity, spin))
    return np.concatenate([q, v])


def _place(scene: Scene, body: SceneBody, q: Array, v: Array, pose: tuple[Array, ...]) -> None:
    """Set position and attitude of a body's root, and its velocity and spin in root axes, in place."""
    position, rotation, velocity, spin = pose
    joint, axes = scene.model.joints[body.root_joint], list(scene.translation_axes)
    turned = rotation[:2, 0] if scene.planar else pin.Quaternion(rotation).coeffs()
    q[joint.idx_q : joint.idx_q + joint.nq] = np.concatenate([position[axes], turned])
    turns = spin[list(scene.rotation_axes)]
    v[joint.idx_v : joint.idx_v + joint.nv] = np.concatenate([velocity[axes], turns])


def moved(model: Any, q: Array, v: Array) -> Any:
    """Pinocchio data with kinematics at a configuration and velocity."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    return data


def _seen(
    scene: Scene, who: tuple[SceneTip, str], readings: Readings, kinematics: tuple[Any, Any, Any]
) -> Array:
    """Estimate the target root's motion from one tip's measurement of a mating frame (4, 3).

    Rows are shift [m] and turn [rad] from the true placement in world axes, velocity [m/s] and spin [rad/s]
    in root axes.
    ``kinematics`` holds Pinocchio data at the start, at the true state, and at the robots' estimated state.
    """
    model, (tip, frame), along, about = scene.model, who, scene.translation_axes, scene.rotation_axes
    start, truth, estimate = kinematics
    mate = model.getFrameId(f"target/{frame}", pin.FrameType.BODY)
    motion = pin.getFrameVelocity(model, truth, mate, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    there, here, first = truth.oMf[mate], truth.oMf[tip.frame], start.oMf[mate].rotation
    assert scene.target is not None
    root = truth.oMi[scene.target.root_joint]

    def read(signal: str, value: Array, axes: tuple[int, ...]) -> Array:
        return _along(readings.get((signal, tip.label)), value, axes)

    # a relative measurement is displaced by the error of the tip's own estimated placement
    error = estimate.oMf[tip.frame].rotation @ here.rotation.T
    turn = read("target_orientation", pin.log3(there.rotation @ first.T), about)
    error = error @ pin.exp3(turn) @ first @ there.rotation.T
    place = read("target_position", there.translation, along)
    place = place + estimate.oMf[tip.frame].translation - here.translation
    velocity, spin = read("target_velocity", motion.linear, along), read("target_spin", motion.angular, about)
    lever = error @ (there.translation - root.translation)
    back = (error @ root.rotation).T
    shift = place - lever - root.translation
    return np.array([shift, pin.log3(error), back @ (velocity - np.cross(spin, lever)), back @ spin])


def _along(reading: Array | None, value: Array, axes: tuple[int, ...]) -> Array:
    """Vector (3,) with the sensor reading along some axes and the true value along the others."""
    return value if reading is None else np.where(np.isin(np.arange(3), axes), reading, value)
