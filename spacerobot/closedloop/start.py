"""Initial configuration and velocity as expressions of the parameters.

The symbolic twin of :mod:`spacerobot.scene.configure`: posture, base poses and the closing of grasps can
be varied and differentiated. A test holds the two to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from spacerobot.closedloop.parameters import Parameters
from spacerobot.dynamics import Kinematics, forward_kinematics, frame_placement
from spacerobot.dynamics.rotations import rotation_from_rpy
from spacerobot.scene import Scene, SceneBody
from spacerobot.scene.configure import closing_order

DEGREE = np.pi / 180


@dataclass(frozen=True)
class Start:
    """The initial state, an expression of the parameters.

    Attributes
    ----------
    q, v
        Configuration (nq x 1) and velocity (nv x 1), Pinocchio's coordinates.
    kinematics
        Of the initial configuration at rest.
    """

    model: Any
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame at the start."""
        return frame_placement(self.model, self.kinematics, frame)


def initial_state(scene: Scene, parameters: Parameters) -> Start:
    """Initial state of a scene as an expression of its parameters."""
    q, v = ca.SX(scene.model.nq, 1), ca.SX(scene.model.nv, 1)
    for body in scene.bodies:
        _set_joints(scene.model, body, parameters, q, v)
        _set_base(scene.model, body, parameters, q, v)
    for body, own, other in closing_order(scene.bodies, scene.grasps):
        kinematics = forward_kinematics(scene.model, q)
        gap = (
            frame_placement(scene.model, kinematics, other)[1]
            - frame_placement(scene.model, kinematics, own)[1]
        )
        index = scene.model.joints[body.root_joint].idx_q
        for axis in range(2 if body.base.joint == "planar" else 3):
            q[index + axis] = gap[axis]
    return Start(scene.model, q, v, forward_kinematics(scene.model, q))


def _set_base(model: Any, body: SceneBody, parameters: Parameters, q: ca.SX, v: ca.SX) -> None:
    """Set a floating base, at the origin if it is placed by closing a grasp; a fixed one is the model's."""
    if not body.root_joint:
        return
    joint = model.joints[body.root_joint]
    path = f"{body.path}.base"
    position = ca.SX(3, 1)
    if body.base.close_grasp is None:
        axes = 2 if body.base.joint == "planar" else 3  # a planar base's height is the model's
        position[:axes] = parameters.vector(f"{path}.position", axes)
    if body.base.joint == "planar":
        yaw = parameters(f"{path}.rotation_deg.2") * DEGREE
        cos, sin = ca.cos(yaw), ca.sin(yaw)
        x, y = parameters(f"{path}.velocity.0"), parameters(f"{path}.velocity.1")
        q[joint.idx_q : joint.idx_q + 4] = ca.vertcat(position[0], position[1], cos, sin)
        spin = parameters(f"{path}.spin_deg.2") * DEGREE
        v[joint.idx_v : joint.idx_v + 3] = ca.vertcat(cos * x + sin * y, cos * y - sin * x, spin)
        return
    rpy = parameters.vector(f"{path}.rotation_deg") * DEGREE
    rotation = rotation_from_rpy(rpy)
    linear = ca.mtimes(rotation.T, parameters.vector(f"{path}.velocity"))
    angular = ca.mtimes(rotation.T, parameters.vector(f"{path}.spin_deg") * DEGREE)
    q[joint.idx_q : joint.idx_q + 7] = ca.vertcat(position, quaternion_from_rpy(rpy))
    v[joint.idx_v : joint.idx_v + 6] = ca.vertcat(linear, angular)


def quaternion_from_rpy(rpy: ca.SX) -> ca.SX:
    """Quaternion x, y, z, w (4 x 1) of roll, pitch, yaw [rad], smooth everywhere."""
    (cr, cp, cy), (sr, sp, sy) = ca.vertsplit(ca.cos(rpy / 2)), ca.vertsplit(ca.sin(rpy / 2))
    return ca.vertcat(
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def _set_joints(model: Any, body: SceneBody, parameters: Parameters, q: ca.SX, v: ca.SX) -> None:
    begins = {}
    for index in body.free_joints:
        name = str(model.names[index]).removeprefix(f"{body.name}/")
        path = f"{body.path}.joints.{name}"
        if body.config.joints[name].offset is not None:
            position, rate = parameters(f"{path}.offset"), parameters(f"{path}.speed")
        else:
            position = parameters(f"{path}.angle_deg") * DEGREE
            rate = parameters(f"{path}.rate_deg") * DEGREE
        begins[index] = (position, rate)
    for tie in body.ties:
        position, rate = begins[tie.leader]
        begins[tie.joint] = (tie.multiplier * position + tie.offset, tie.multiplier * rate)
    for index, (position, rate) in begins.items():
        joint = model.joints[index]
        v[joint.idx_v] = rate
        if joint.nq == 2:
            q[joint.idx_q : joint.idx_q + 2] = ca.vertcat(ca.cos(position), ca.sin(position))
        else:
            q[joint.idx_q] = position
