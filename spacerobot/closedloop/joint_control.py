"""Joint PD towards the inverse kinematics of the references (Eq. 34, Fig. 1).

    tau_i = K_p2 (theta_d,i - theta_i) - K_d2 theta_i'

The desired joint positions theta_d are states of the controller: it solves the inverse kinematics of its
references by closed-loop resolved rates, as a robot would that believes its base to be where it began,

    theta_d' = J^+ (x_ref' + k (x_ref - x(theta_d))),   J^+ = J^T (J J^T + lambda^2 1)^-1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.references import Motion
from spacerobot.closedloop.start import Start
from spacerobot.closedloop.states import State
from spacerobot.closedloop.tip_control import Calibrations, orientation_error
from spacerobot.dynamics import Kinematics, forward_kinematics, frame_jacobian, frame_placement
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.scenario import Robot
from spacerobot.scene import SceneBody, SceneTip


@dataclass(frozen=True)
class JointControl:
    """Joint PD of one robot.

    Attributes
    ----------
    torque
        Generalized forces (nv x 1), before any projection.
    null_space
        Whether only the part that does not accelerate the tips shall act.
    state
        Desired positions of its free joints.
    """

    body: SceneBody
    torque: ca.SX
    null_space: bool
    state: State


def build_joint_control(
    plant: Plant,
    body: SceneBody,
    motions: Mapping[str, Motion],
    start: Start,
    parameters: Parameters,
    constants: Constants,
) -> JointControl | None:
    """Joint PD of a robot; none if the scenario asks for none."""
    config = body.config.joint_pd if isinstance(body.config, Robot) else None
    if config is None:
        return None
    path = f"{body.path}.joint_pd"
    kp, kd = (constants.hoist(f"{path}.{key}", parameters(f"{path}.{key}")) for key in ("kp", "kd"))
    desired = ca.SX.sym(f"{body.name}/theta_d", len(body.free_joints))
    rate = _inverse_kinematics(plant, body, desired, motions, start, parameters, constants)
    calibrate = Calibrations(body, parameters, constants)
    torque = ca.SX(plant.v.size1(), 1)
    for i, joint in enumerate(body.free_joints):
        column = plant.model.joints[joint].idx_v
        position = _measured(calibrate("joint_position"), _nearest(plant.model, joint, plant.q, desired[i]))
        speed = _measured(calibrate("joint_rate"), plant.v[column])
        torque[column] = kp * (desired[i] - position) - kd * speed  # Eq. 34
    initial = ca.vertcat(*(joint_position(plant.model, joint, plant.q) for joint in body.free_joints))
    state = State(f"{body.name}/joint_pd.theta_d", desired, initial, rate)
    return JointControl(body, torque, config.null_space, state)


def joint_position(model: Any, joint: int, q: ca.SX) -> ca.SX:
    """Position of a one-degree-of-freedom joint [rad or m]; an unbounded one is read from its cos and sin."""
    pin_joint = model.joints[joint]
    if pin_joint.nq == 2:
        return ca.atan2(q[pin_joint.idx_q + 1], q[pin_joint.idx_q])
    return q[pin_joint.idx_q]


def _nearest(model: Any, joint: int, q: ca.SX, desired: ca.SX) -> ca.SX:
    """Position of a joint; of an unbounded one that which is nearest to the desired position.

    The desired position may pass half a turn, where the angle read from cos and sin jumps by a whole one.
    """
    pin_joint = model.joints[joint]
    if pin_joint.nq == 1:
        return joint_position(model, joint, q)
    cos, sin = q[pin_joint.idx_q], q[pin_joint.idx_q + 1]
    behind = ca.atan2(
        sin * ca.cos(desired) - cos * ca.sin(desired), cos * ca.cos(desired) + sin * ca.sin(desired)
    )
    return desired + behind


def _measured(calibration: tuple[ca.SX | None, ca.SX], signal: ca.SX) -> ca.SX:
    offset, scale = calibration
    return scale * signal if offset is None else offset + scale * signal


def _inverse_kinematics(
    plant: Plant,
    body: SceneBody,
    desired: ca.SX,
    motions: Mapping[str, Motion],
    start: Start,
    parameters: Parameters,
    constants: Constants,
) -> ca.SX:
    """Rate of the desired joint positions (n x 1); a robot without tips keeps its posture."""
    tips = [tip for tip in plant.scene.tips if tip.body.name == body.name]
    if not tips:
        return ca.SX.zeros(desired.size1())
    path = f"{body.path}.joint_pd"
    rate_gain, damping = (
        constants.hoist(f"{path}.{key}", parameters(f"{path}.{key}")) for key in ("ik_rate", "ik_damping")
    )
    q = constants.hoist(f"{path}.start", start.q)
    positions = dict(zip(body.free_joints, ca.vertsplit(desired), strict=True))
    positions |= {tie.joint: tie.multiplier * positions[tie.leader] + tie.offset for tie in body.ties}
    for joint, position in positions.items():
        pin_joint = plant.model.joints[joint]
        if pin_joint.nq == 2:
            q[pin_joint.idx_q : pin_joint.idx_q + 2] = ca.vertcat(ca.cos(position), ca.sin(position))
        else:
            q[pin_joint.idx_q] = position
    kinematics = forward_kinematics(plant.model, q)
    rows, wanted = _tasks(plant, tips, kinematics, motions, rate_gain)
    columns = [int(plant.model.idx_vs[joint]) for joint in body.free_joints]
    jacobian = plant.gathered(ca.vertcat(*rows).T).T[:, columns]
    gram = ca.mtimes(jacobian, jacobian.T) + damping**2 * ca.SX.eye(jacobian.size1())
    return ca.mtimes(jacobian.T, SymmetricFactors(gram).solve(ca.vertcat(*wanted)))


def _tasks(
    plant: Plant, tips: Sequence[SceneTip], kinematics: Kinematics, motions: Mapping[str, Motion], gain: ca.SX
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Jacobian rows and wanted velocities of all tips: positions, and orientations where controlled."""
    scene, rows, wanted = plant.scene, [], []
    for tip in tips:
        motion = motions[tip.label]
        jacobian = frame_jacobian(plant.model, kinematics, tip.frame)
        turned, position = frame_placement(plant.model, kinematics, tip.frame)
        axes = list(scene.translation_axes)
        rows.append(jacobian[axes, :])
        wanted.append((motion.velocity + gain * (motion.position - position))[axes])
        if tip.config.orientation_pid is not None:
            axes = list(scene.rotation_axes)
            error = orientation_error(scene, motion.rotation, turned)
            rows.append(jacobian[[axis + 3 for axis in axes], :])
            wanted.append((motion.angular_velocity + gain * error)[axes])
    return rows, wanted
