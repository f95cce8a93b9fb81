"""Labelled data of a trajectory.

Every variable carries ``units`` and ``long_name``. Dimensions: ``time`` [s], ``tip`` (``rpr1/tip``),
``body`` (robots, then ``target``), ``joint`` (``rpr1/joint_1``, its ``joint_kind`` beside it: units of a
prismatic one are m, m/s and N), ``grasp``, ``axis`` (x, y, z of the world), ``quaternion`` (x, y, z, w), and
the components of the state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import xarray as xr

from spacerobot.rollout import Trajectory
from spacerobot.scene import Scene
from spacerobot.scene.scene import Array

AXES = ("x", "y", "z")

VECTORS = {
    "tip_position": ("tip", "m", "position of tips"),
    "tip_velocity": ("tip", "m/s", "velocity of tips"),
    "tip_reference": ("tip", "m", "reference position of tips"),
    "tip_error": ("tip", "m", "reference minus position of tips"),
    "tip_orientation_error": ("tip", "rad", "rotation vector from tips to their references"),
    "body_position": ("body", "m", "position of bodies' root links"),
    "body_rotation": ("body", "rad", "rotation vector of bodies' root links since the start"),
    "grasp_force": ("grasp", "N", "force of grasps on the target"),
    "grasp_torque": ("grasp", "N m", "torque of grasps on the target, at the tip"),
    "grasp_gap": ("grasp", "m", "from mating frames to tips"),
    "body_momentum_linear": ("body", "N s", "linear momentum of bodies"),
    "body_momentum_angular": ("body", "N m s", "angular momentum of bodies about the world's origin"),
}
"""Outputs of three components for each label: dimension, unit, long name. All in world axes."""

TOTALS = {
    "momentum_linear": ("N s", "linear momentum of everything"),
    "momentum_angular": ("N m s", "angular momentum of everything about the world's origin"),
}

ENERGIES = {
    "energy_kinetic": "kinetic energy",
    "energy_spring": "energy held in the grips' springs",
    "energy_potential": "potential energy of gravity",
    "work_actuator": "work put in by the actuators since the start",
    "work_joint": "work taken by the joints' resistance since the start",
    "work_grasp": "work taken by the grips' dampers since the start",
    "work_constraint": "work put in by rigid grasps since the start",
}


def build_dataset(scene: Scene, trajectory: Trajectory, state_names: Sequence[str]) -> xr.Dataset:
    """Dataset of a trajectory.

    Parameters
    ----------
    scene
        The scene.
    trajectory
        States and outputs over time.
    state_names
        Names of the state's components, as the closed loop gives them.
    """
    nq, nv = scene.model.nq, scene.model.nv
    q, v, z = np.split(trajectory.state, [nq, nq + nv], axis=1)
    variables: dict[str, xr.DataArray] = {
        "q": _array(q, ("time", "configuration"), "m, rad or 1", "configuration in Pinocchio's coordinates"),
        "v": _array(
            v,
            ("time", "velocity"),
            "m/s or rad/s",
            "velocity in Pinocchio's coordinates, of a base in its own axes",
        ),
        "z": _array(z, ("time", "controller"), "SI", "states of controllers and energy balance"),
    }
    outputs = trajectory.outputs
    for name, (dimension, unit, text) in VECTORS.items():
        shape = (len(trajectory.time), -1, 3)
        variables[name] = _array(outputs[name].reshape(shape), ("time", dimension, "axis"), unit, text)
    for name, (unit, text) in TOTALS.items():
        variables[name] = _array(outputs[name], ("time", "axis"), unit, text)
    for name, text in ENERGIES.items():
        variables[name] = _array(outputs[name][:, 0], ("time",), "J", text)
    variables |= _orientations(scene, q) | _joints(scene, q, v, outputs["joint_torque"])
    coordinates = {
        "time": ("time", trajectory.time, {"units": "s", "long_name": "time"}),
        "tip": [tip.label for tip in scene.tips],
        "body": [body.name for body in scene.bodies],
        "joint": _joint_labels(scene),
        "joint_kind": ("joint", _joint_kinds(scene)),
        "grasp": [grasp.name for grasp in scene.grasps],
        "axis": list(AXES),
        "quaternion": ["x", "y", "z", "w"],
        "configuration": list(state_names[:nq]),
        "velocity": list(state_names[nq : nq + nv]),
        "controller": list(state_names[nq + nv :]),
    }
    return xr.Dataset(variables, coordinates)


def _array(values: Array, dims: tuple[str, ...], unit: str, text: str) -> xr.DataArray:
    return xr.DataArray(np.ascontiguousarray(values), dims=dims, attrs={"units": unit, "long_name": text})


def _arm_joints(scene: Scene) -> list[int]:
    return sorted(joint for body in scene.bodies for joint in body.joints)


def _joint_labels(scene: Scene) -> list[str]:
    return [str(scene.model.names[joint]) for joint in _arm_joints(scene)]


def _joint_kinds(scene: Scene) -> list[str]:
    """Revolute, continuous or prismatic, in the order of the labels."""
    kinds = {
        f"{body.name}/{joint.name}": str(joint.kind)
        for body in scene.bodies
        for joint in body.description.joints
    }
    return [kinds[label] for label in _joint_labels(scene)]


def _orientations(scene: Scene, q: Array) -> dict[str, xr.DataArray]:
    """Quaternions of the root links and, in a planar scene, their unwrapped angle about z."""
    count, bodies = len(q), scene.bodies
    quaternion = np.empty((count, len(bodies), 4))
    angle = np.empty((count, len(bodies)))
    for i, body in enumerate(bodies):
        joint = scene.model.joints[body.root_joint]
        if body.base.joint == "planar":
            angle[:, i] = np.unwrap(np.arctan2(q[:, joint.idx_q + 3], q[:, joint.idx_q + 2]))
            quaternion[:, i] = 0.0
            quaternion[:, i, 2], quaternion[:, i, 3] = np.sin(angle[:, i] / 2), np.cos(angle[:, i] / 2)
        elif body.base.joint == "free_flyer":
            quaternion[:, i] = q[:, joint.idx_q + 3 : joint.idx_q + 7]
        else:
            rotation = pin.rpy.rpyToMatrix(np.radians(body.base.rotation_deg))
            quaternion[:, i] = pin.Quaternion(rotation).coeffs()
            angle[:, i] = np.radians(body.base.rotation_deg[2])
    dims = ("time", "body", "quaternion")
    found = {"body_orientation": _array(quaternion, dims, "1", "orientation of root links, quaternion")}
    if scene.planar:
        found["body_angle"] = _array(angle, ("time", "body"), "rad", "angle of root links about z, unwrapped")
    return found


def _joints(scene: Scene, q: Array, v: Array, torque: Array) -> dict[str, xr.DataArray]:
    joints = [scene.model.joints[j] for j in _arm_joints(scene)]
    position = np.empty((len(q), len(joints)))
    for i, joint in enumerate(joints):
        if joint.nq == 2:
            position[:, i] = np.unwrap(np.arctan2(q[:, joint.idx_q + 1], q[:, joint.idx_q]))
        else:
            position[:, i] = q[:, joint.idx_q]
    slides = "prismatic" in _joint_kinds(scene)
    units = ("rad or m", "rad/s or m/s", "N m or N") if slides else ("rad", "rad/s", "N m")
    dims, rates = ("time", "joint"), v[:, [joint.idx_v for joint in joints]]
    return {
        "joint_position": _array(position, dims, units[0], "joint positions"),
        "joint_velocity": _array(rates, dims, units[1], "joint rates"),
        "joint_torque": _array(torque, dims, units[2], "actuator torques"),
    }
