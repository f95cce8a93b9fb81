"""Labelled data of a trajectory.

Every variable has the attributes ``units`` and ``long_name``. Dimensions: ``time`` [s], ``tip``
(``rpr1/tip``), ``body`` (robots, then ``target``), ``joint`` (arm joints, ``rpr1/joint_1``), ``grasp``,
``contact``, ``wheel`` and others if there are any, ``axis`` (x, y, z of the world), ``quaternion`` (x, y, z,
w), and the components of the state. The coordinate ``joint_kind`` gives the kind of each joint: the units of
prismatic joints are m, m/s and N.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.rollout import Trajectory
from spacerobot.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

AXES = ("x", "y", "z")


def build_dataset(scene: Scene, trajectory: Trajectory, loop: ClosedLoop) -> xr.Dataset:
    """Dataset of a trajectory.

    Args:
        scene: The scene.
        trajectory: States and outputs over time.
        loop: Closed loop, which lists the output variables.
    """
    import xarray as xr

    nq, nv, names = scene.model.nq, scene.model.nv, loop.state_names
    q, v, z = np.split(trajectory.state, [nq, nq + nv], axis=1)
    variables: dict[str, xr.Variable] = {
        "q": _array(q, ("time", "configuration"), "m, rad or 1", "configuration in Pinocchio's coordinates"),
        "v": _array(
            v,
            ("time", "velocity"),
            "m/s or rad/s",
            "velocity in Pinocchio's coordinates, of a base in its own axes",
        ),
        "z": _array(z, ("time", "controller"), "SI", "states of controllers and energy balance"),
    }
    variables = {name: _unplotted(array) for name, array in variables.items()}
    for variable in loop.variables:
        shape = (
            len(trajectory.time),
            *((-1, 3) if len(variable.dims) == 2 else (-1,) if variable.dims else ()),
        )
        values = trajectory.outputs[variable.name].reshape(shape)
        unit = _unit(scene, variable.unit) if "joint" in variable.dims else variable.unit
        array = _array(values, ("time", *variable.dims), unit, variable.text)
        variables[variable.name] = array if variable.plotted else _unplotted(array)
    for name, sign in loop.works.items():
        variables[f"work_{name}"].attrs["sign"] = sign
    # quaternions of the root links and, in a planar scene, their unwrapped angle about z
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
    orientations = {
        "body_orientation": _unplotted(_array(quaternion, dims, "1", "orientation of root links, quaternion"))
    }
    if scene.planar:
        orientations["body_angle"] = _array(
            angle, ("time", "body"), "rad", "angle of root links about z, unwrapped"
        )
    joints, along = _arm_joints(scene), ("time", "joint")
    position, rates = scene.joint_positions(joints, q), v[:, [scene.model.idx_vs[j] for j in joints]]
    variables |= orientations | {
        "joint_position": _array(position, along, _unit(scene, "rad or m"), "joint positions"),
        "joint_velocity": _array(rates, along, _unit(scene, "rad/s or m/s"), "joint rates"),
    }
    coordinates = {
        "time": ("time", trajectory.time, {"units": "s", "long_name": "time"}),
        "tip": [tip.label for tip in scene.tips],
        "body": [body.name for body in scene.bodies],
        "joint": _joint_labels(scene),
        "joint_kind": ("joint", _joint_kinds(scene)),
        "grasp": [grasp.name for grasp in scene.grasps],
        "axis": list(AXES),
        "quaternion": ["x", "y", "z", "w"],
        "configuration": list(names[:nq]),
        "velocity": list(names[nq : nq + nv]),
        "controller": list(trajectory.state_names or names[nq + nv :]),
    }
    for variable in loop.variables:
        if variable.labels:
            coordinates.setdefault(variable.dims[0], list(variable.labels))
    return xr.Dataset(variables, coordinates, {"outside": ", ".join(loop.outside)})


def _unplotted(array: xr.Variable) -> xr.Variable:
    """Variable that pages do not plot over time."""
    array.attrs["plotted"] = 0
    return array


def _array(values: Array, dims: tuple[str, ...], unit: str, text: str) -> xr.Variable:
    import xarray as xr

    return xr.Variable(dims, np.ascontiguousarray(values), {"units": unit, "long_name": text})


def _arm_joints(scene: Scene) -> list[int]:
    return sorted(joint for body in scene.bodies for joint in body.arm_joints)


def _joint_labels(scene: Scene) -> list[str]:
    return [str(scene.model.names[joint]) for joint in _arm_joints(scene)]


def _joint_kinds(scene: Scene) -> list[str]:
    """Kinds of the arm joints (revolute, continuous or prismatic) in the order of the labels."""
    kinds = scene.joint_kinds
    return [kinds[label] for label in _joint_labels(scene)]


def _unit(scene: Scene, unit: str) -> str:
    """Unit of a joint variable: ``rad or m`` in a scene with prismatic joints, else ``rad``."""
    return unit if "prismatic" in _joint_kinds(scene) else unit.partition(" or ")[0]
