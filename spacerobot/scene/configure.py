"""Initial configuration and velocity, with bases placed so that their grasps start closed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scene import base_alignment
from spacerobot.scene.grasp_closing import begun, find_closings, is_rigid
from spacerobot.scene.scene import Scene, SceneBody, SceneGrasp


def initial_state(
    model: Any, bodies: Sequence[SceneBody], grasps: Sequence[SceneGrasp], *, source: Path | None
) -> tuple[Array, Array]:
    """Initial configuration (nq,) and velocity (nv,) as stated, with bases placed to close their grasps.

    Raises:
        ScenarioError: If the placements of bases depend on each other.
    """
    q, v = pin.neutral(model), np.zeros(model.nv)
    closings = find_closings(bodies, grasps, source=source)
    giving = {closing.body.name: closing for closing in closings}
    turned: dict[int, base_alignment.Quaternion] = {}
    for body in bodies:
        # joints as described
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
            turned[index] = base_alignment.joint(model, index, np.cos(angle / 2), np.sin(angle / 2))
        # a floating base as stated, zero for coordinates that a grasp determines
        if body.root_joint:
            closing = giving.get(body.name)
            root = model.joints[body.root_joint]
            rotation = pin.rpy.rpyToMatrix(np.radians(body.base.rotation_deg))
            position = np.array(body.base.position) * (closing is None)
            linear = rotation.T @ body.base.velocity * (closing is None or not closing.sets_velocity)
            angular = rotation.T @ np.radians(body.base.spin_deg) * (closing is None or not closing.sets_spin)
            if body.base.joint == "planar":
                yaw = np.radians(body.base.rotation_deg[2])
                q[root.idx_q : root.idx_q + 4] = [position[0], position[1], np.cos(yaw), np.sin(yaw)]
                v[root.idx_v : root.idx_v + 3] = [linear[0], linear[1], angular[2]]
            else:
                q[root.idx_q : root.idx_q + 7] = [*position, *_turn(body.base.rotation_deg)]
                v[root.idx_v : root.idx_v + 6] = np.concatenate([linear, angular])
            turned[body.root_joint] = _turn(body.base.rotation_deg)
    for closing in closings:
        if closing.aligns:
            # rotate a base so that its grasp starts aligned, and express its stated velocity in the new
            # axes
            joint = model.joints[closing.body.root_joint]
            offset = _turn(closing.body.base.align_rotation_deg)
            orientation = base_alignment.aligned(model, closing, turned, offset)
            if joint.nv == 3:
                orientation = base_alignment.upright(orientation, np.hypot(*orientation[2:]))
            rotation = pin.Quaternion(np.array(orientation, dtype=float)).toRotationMatrix()
            if joint.nv == 3:
                q[joint.idx_q + 2 : joint.idx_q + 4] = rotation[:2, 0]
            else:
                q[joint.idx_q + 3 : joint.idx_q + 7] = orientation
            size = 2 if joint.nv == 3 else 3
            for first in range(joint.idx_v, joint.idx_v + joint.nv - 1, 3):
                v[first : first + size] = rotation[:size, :size].T @ v[first : first + size]
            turned[closing.body.root_joint] = orientation
        # translate a base, and set its velocity, so that its grasp starts closed
        data = model.createData()
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacements(model, data)
        base, joint = data.oMi[closing.body.root_joint], model.joints[closing.body.root_joint]
        origin, other = data.oMf[closing.own].translation, data.oMf[closing.other].translation
        q[joint.idx_q : joint.idx_q + closing.axes] += (other - origin)[: closing.axes]
        if closing.sets_velocity:
            slip = _velocity(model, data, closing.other) - _velocity(model, data, closing.own)
            spin = slip[3:] if closing.sets_spin else np.zeros(3)
            linear = base.rotation.T @ (slip[:3] - np.cross(spin, origin - base.translation))
            angular = base.rotation.T @ spin
            v[joint.idx_v : joint.idx_v + joint.nv] += (
                [*linear[:2], angular[2]] if joint.nv == 3 else [*linear, *angular]
            )
    return q, v


def _velocity(model: Any, data: Any, frame: int) -> Array:
    """Linear and angular velocity of a frame's origin, world axes (6,)."""
    return np.array(pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).vector)


def close_velocity(scene: Scene) -> Array:
    """Velocity (nv,) that all rigid grasps allow, nearest to the stated one.

    The change has minimum kinetic energy: it is the plastic impact of grasps that close at once on bodies
    moving as stated, and conserves momentum. It is zero if bases could close every grasp.
    """
    grasps = [grasp for grasp in begun(scene.grasps) if is_rigid(grasp)]
    rows = np.vstack([relative_jacobian(scene, grasp) for grasp in grasps])
    upper = np.triu(pin.crba(scene.model, scene.model.createData(), scene.q))
    free = scene.spread[:, np.diag(scene.spread) > 0]
    inertia = free.T @ (upper + np.triu(upper, 1).T) @ free
    response = free @ np.linalg.solve(inertia, (rows @ free).T)
    closed: Array = scene.v - response @ np.linalg.solve(rows @ response, rows @ scene.v)
    return closed


def relative_jacobian(scene: Scene, grasp: SceneGrasp) -> Array:
    """Jacobian (rows, nv) of a tip's velocity relative to the target, in world axes.

    The target's velocity is that of its material point at the tip. Rows: two (planar) or three translations,
    followed for a weld by one or three rotations.
    """
    model, data = scene.model, scene.model.createData()
    pin.computeJointJacobians(model, data, scene.q)
    pin.updateFramePlacements(model, data)
    frames = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    tip = pin.getFrameJacobian(model, data, grasp.tip.frame, frames)
    mate = pin.getFrameJacobian(model, data, grasp.frame, frames)
    arm = data.oMf[grasp.tip.frame].translation - data.oMf[grasp.frame].translation
    linear = tip[:3] - (mate[:3] - pin.skew(arm) @ mate[3:])
    jacobian: Array = linear[list(scene.translation_axes)]
    if grasp.config.fixes_orientation:
        jacobian = np.vstack([jacobian, (tip[3:] - mate[3:])[list(scene.rotation_axes)]])
    return jacobian


def _turn(rpy_deg: Sequence[float]) -> base_alignment.Quaternion:
    """Quaternion of roll, pitch, yaw [deg]."""
    halves = np.radians(rpy_deg) / 2
    return base_alignment.rpy(tuple(np.cos(halves)), tuple(np.sin(halves)))
