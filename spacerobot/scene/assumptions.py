"""What was assumed where a scenario is silent, in sentences for people."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacerobot.scenario import Compliant, Robot
from spacerobot.scene.scene import Scene, SceneBody, SceneTip


def list_assumptions(scene: Scene) -> tuple[str, ...]:
    """Every assumption taken, in the order of the scenario."""
    found = ["nothing can leave the x-y plane: two translations and one rotation"] if scene.planar else []
    if not any(scene.scenario.gravity):
        found.append("no gravity, no orbital motion: the world frame is inertial")
    for body in scene.bodies:
        found += _of_body(scene, body)
    for tip in scene.tips:
        found += _of_tip(tip)
    for grasp in scene.grasps:
        kind = grasp.config
        if isinstance(kind, Compliant):
            found.append(f"{grasp.path}: one pair of opposite forces at the tip's point; never lets go")
            if kind.rotational_stiffness:
                found.append(f"{grasp.path}: rotational spring at rest in the initial relative orientation")
        elif kind.kind == "weld":
            found.append(f"{grasp.path}: welded in the initial relative orientation; never lets go")
    if scene.grasps:
        found.append("no contact except in the grasps: bodies may pass through each other")
    return tuple(found)


def list_warnings(scene: Scene) -> tuple[str, ...]:
    """What a user should look at: from the URDFs, and postures outside joint limits."""
    found = []
    for body in scene.bodies:
        found += [f"{body.path}: {warning}" for warning in body.description.warnings]
        for joint in body.description.joints:
            state = body.config.joints.get(joint.name)
            if state is None or joint.kind == "continuous":
                continue
            value = np.radians(state.angle_deg or 0.0) + (state.offset or 0.0)
            if not joint.lower <= value <= joint.upper:
                found.append(
                    f"{body.path}.joints.{joint.name}: begins at {value:.4g}, outside the URDF's limits "
                    f"{joint.lower:.4g} to {joint.upper:.4g}; limits are not enforced"
                )
    return tuple(found)


def _of_body(scene: Scene, body: SceneBody) -> list[str]:
    found = []
    if body.base.close_grasp is not None:
        data = scene.model.createData()
        pin.framesForwardKinematics(scene.model, data, scene.q)
        x, y, z = data.oMf[body.root_frame].translation
        found.append(
            f"{body.path}.base: placed at ({x:.4f}, {y:.4f}, {z:.4f}) m so that grasp "
            f"{body.base.close_grasp!r} closes"
        )
    if not isinstance(body.config, Robot):
        return found
    controlled = any(tip.config.pid or tip.config.orientation_pid for tip in scene.tips if tip.body is body)
    if not controlled and not body.config.joint_pd:
        found.append(f"{body.path}: no controller, so its joints are passive")
    if body.config.sensors is None:
        found.append(f"{body.path}: ideal sensors (a = 0, b = 1)")
    if not body.config.torque_limits:
        found.append(f"{body.path}: torques are not limited")
    return found


def _of_tip(tip: SceneTip) -> list[str]:
    found = []
    if tip.from_target:
        found.append(f"{tip.path}: reference derived from the target's, rigidly")
    elif tip.config.reference is None and (tip.config.pid or tip.config.orientation_pid):
        found.append(f"{tip.path}: no reference given, so it holds its initial pose")
    for name, pid in (("pid", tip.config.pid), ("orientation_pid", tip.config.orientation_pid)):
        if pid is not None and pid.feedback == "base":
            found.append(f"{tip.path}.{name}: feeds back the velocity seen from the base, blind to its drift")
        if pid is not None and pid.derivative == "ideal" and pid.kd > 0:
            found.append(f"{tip.path}.{name}: ideal derivative, its algebraic loop solved exactly")
    return found
