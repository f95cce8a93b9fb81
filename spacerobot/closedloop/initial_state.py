"""Initial configuration and velocity as expressions of the parameters.

The symbolic counterpart of :mod:`spacerobot.scene.configure`: posture, base poses and the closing of grasps
can be varied and differentiated. A test compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from spacerobot.dynamics import forward_kinematics, frame_placement, frame_velocity
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.rotations import rotation_from_quaternion, rotation_from_rpy
from spacerobot.scene import Scene, SceneBody, base_alignment
from spacerobot.scene.grasp_closing import ClosingBase, find_closings
from spacerobot.symbolic import InitialState, Parameters

DEGREE = np.pi / 180


def initial_state(scene: Scene, parameters: Parameters) -> InitialState:
    """Initial state of a scene as an expression of its parameters.

    Bases are placed in closed form so that their grasps close. Velocities in loops are corrected by
    :func:`~spacerobot.closedloop.impulse.strike`, which needs inertias.
    """
    q, v = ca.SX(scene.model.nq, 1), ca.SX(scene.model.nv, 1)
    closings = find_closings(scene.bodies, scene.grasps)
    giving = {closing.body.name: closing for closing in closings}
    turned: dict[int, base_alignment.Quaternion] = {}
    for body in scene.bodies:
        turned |= _set_joints(scene.model, body, parameters, q, v)
        turned |= _set_base(scene.model, body, giving.get(body.name), parameters, q, v)
    for closing in closings:
        if closing.aligns:
            vector = parameters.sparse_vector(f"{closing.body.path}.base.align_rotation_deg")
            orientation = base_alignment.aligned(scene.model, closing, turned, _turn(vector * DEGREE))
            turned[closing.body.root_joint] = _align(scene.model, closing, orientation, q, v)
        # translate a base, and set its velocity, so that its grasp starts closed
        root = closing.body.root_joint
        joint = scene.model.joints[root]
        kinematics = forward_kinematics(scene.model, q, v if closing.sets_velocity else None)
        point, other = (
            frame_placement(scene.model, kinematics, frame)[1] for frame in (closing.own, closing.other)
        )
        gap = other - point
        for axis in range(closing.axes):
            q[joint.idx_q + axis] += gap[axis]
        if closing.sets_velocity:
            own_velocity, other_velocity = (
                frame_velocity(scene.model, kinematics, frame) for frame in (closing.own, closing.other)
            )
            linear, rotation = other_velocity[0] - own_velocity[0], kinematics.rotation[root]
            spin = other_velocity[1] - own_velocity[1] if closing.sets_spin else ca.SX(3, 1)
            linear = ca.mtimes(rotation.T, linear - cross(spin, point - kinematics.origin[root]))
            angular = ca.mtimes(rotation.T, spin)
            twist = ca.vertcat(linear[:2], angular[2]) if joint.nv == 3 else ca.vertcat(linear, angular)
            v[joint.idx_v : joint.idx_v + joint.nv] += twist
    return InitialState(scene.model, q, v, forward_kinematics(scene.model, q))


def _align(
    model: Any, closing: ClosingBase, orientation: base_alignment.Quaternion, q: ca.SX, v: ca.SX
) -> base_alignment.Quaternion:
    """Rotate a base so that its grasp starts aligned, and express its stated velocity in the new axes."""
    joint = model.joints[closing.body.root_joint]
    if joint.nv == 3:
        orientation = base_alignment.upright(orientation, ca.sqrt(orientation[2] ** 2 + orientation[3] ** 2))
    quaternion = ca.SX(ca.vertcat(*orientation))
    rotation = rotation_from_quaternion(quaternion)
    if joint.nv == 3:
        q[joint.idx_q + 2 : joint.idx_q + 4] = rotation[:2, 0]
    else:
        q[joint.idx_q + 3 : joint.idx_q + 7] = quaternion
    size = 2 if joint.nv == 3 else 3
    for first in range(joint.idx_v, joint.idx_v + joint.nv - 1, 3):
        v[first : first + size] = ca.mtimes(rotation[:size, :size].T, v[first : first + size])
    return orientation


def _set_base(
    model: Any, body: SceneBody, closing: ClosingBase | None, parameters: Parameters, q: ca.SX, v: ca.SX
) -> Mapping[int, base_alignment.Quaternion]:
    """Set the stated pose and motion of a floating base in q and v, with zeros where a grasp determines them.

    A fixed base is part of the model.

    Returns:
        Rotation of the base by joint id; empty for a fixed base.
    """
    if not body.root_joint:
        return {}
    joint, planar = model.joints[body.root_joint], body.base.joint == "planar"
    along, about = (
        ((0, 1), (2,)) if planar else ((0, 1, 2), (0, 1, 2))
    )  # a planar base's height is the model's

    def described(key: str, places: tuple[int, ...], follows: bool = False) -> ca.SX:
        vector = ca.SX(3, 1)
        for i in () if follows else places:
            vector[i] = parameters(f"{body.path}.base.{key}.{i}")
        return vector

    position = described("position", along, closing is not None)
    rpy = described("rotation_deg", about, closing is not None and closing.aligns) * DEGREE
    linear = described("velocity", along, closing is not None and closing.sets_velocity)
    angular = described("spin_deg", about, closing is not None and closing.sets_spin) * DEGREE
    if planar:
        cos, sin = ca.cos(rpy[2]), ca.sin(rpy[2])
        x, y = linear[0], linear[1]
        q[joint.idx_q : joint.idx_q + 4] = ca.vertcat(position[:2], cos, sin)
        v[joint.idx_v : joint.idx_v + 3] = ca.vertcat(cos * x + sin * y, cos * y - sin * x, angular[2])
        return {body.root_joint: _turn(rpy)}
    rotation = rotation_from_rpy(rpy)
    q[joint.idx_q : joint.idx_q + 7] = ca.vertcat(position, *_turn(rpy))
    v[joint.idx_v : joint.idx_v + 6] = ca.vertcat(
        ca.mtimes(rotation.T, linear), ca.mtimes(rotation.T, angular)
    )
    return {body.root_joint: _turn(rpy)}


def _turn(rpy: ca.SX) -> base_alignment.Quaternion:
    """Quaternion of roll, pitch, yaw (3x1) [rad]."""
    return base_alignment.rpy(ca.vertsplit(ca.cos(rpy / 2)), ca.vertsplit(ca.sin(rpy / 2)))


def _set_joints(
    model: Any, body: SceneBody, parameters: Parameters, q: ca.SX, v: ca.SX
) -> Mapping[int, base_alignment.Quaternion]:
    """Set positions and rates of a body's joints in q and v; return the joints' rotations by their ids."""
    begins, turned = {}, {}
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
        turned[index] = base_alignment.joint(model, index, ca.cos(position / 2), ca.sin(position / 2))
    return turned
