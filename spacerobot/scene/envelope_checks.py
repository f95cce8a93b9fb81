"""Checks for capture envelopes that no motion can reach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scenario import Robot
from spacerobot.scene.reference_checks import lengths_to_root, reach
from spacerobot.scene.scene import Scene, SceneBody


def envelope_warnings(scene: Scene) -> list[str]:
    """Warnings about envelopes that cannot be reached by any controller.

    Without external forces, the centres of mass of robot and target move uniformly until a capture. The
    distance of a tip from its robot's centre of mass, and of a mating frame from the target's, is bounded by
    the lengths of links.
    """
    open_grasps = [grasp for grasp in scene.grasps if grasp.config.begins == "open"]
    acted_on = any(isinstance(body.config, Robot) and body.config.actuators for body in scene.bodies)
    outside = scene.contacts or any(scene.scenario.gravity) or scene.scenario.environment or acted_on
    if len(open_grasps) < len(scene.grasps) or outside:
        return []
    distant = []
    for grasp in open_grasps:
        capture, target = grasp.config.capture, scene.target
        if target is None or capture is None or capture.distance is None:
            continue
        data = scene.model.createData()
        pin.forwardKinematics(scene.model, data, scene.q, scene.v)
        pin.updateFramePlacements(scene.model, data)
        robot, reach = _centre(scene, data, grasp.tip.body), _within(scene, grasp.tip.body, grasp.tip.frame)
        aim, other = _centre(scene, data, target), _within(scene, target, grasp.frame)
        apart, speed = aim[0] - robot[0], aim[1] - robot[1]
        square, duration = float(speed @ speed), scene.scenario.simulation.duration
        nearest_at = float(np.clip(-(apart @ speed) / square, 0, duration)) if square else 0.0
        nearest = float(np.linalg.norm(apart + nearest_at * speed))
        if nearest > reach + other + capture.distance:
            distant.append(
                f"{grasp.path}.capture.distance: never holds: in {duration:g} s the centres of mass of "
                f"{grasp.tip.body.name} and the target come no nearer than {nearest:.4g} m, and the tip "
                f"reaches {reach:.4g} m from the one, the mating frame {other:.4g} m from the other"
            )
    # a capture changes the motion of the target for the other grasps
    return distant if len(distant) == len(open_grasps) else []


def mating_warnings(scene: Scene) -> list[str]:
    """Warnings about references and plan goals that mate a tip at an angle outside its capture envelope.

    Both state roll, pitch and yaw of the tip in the mating frame (``mated_deg``). If they differ by more than
    the envelope's ``misalignment_deg``, following the reference never satisfies the envelope.
    """
    warnings = []
    for grasp in scene.grasps:
        capture = grasp.config.capture
        if capture is None or capture.misalignment_deg is None:
            continue
        leads: list[tuple[str, Any]] = [
            (reference.path, reference.config)
            for reference in grasp.tip.references
            if reference.config.follows == grasp.config.frame
        ]
        goals = {} if scene.scenario.plan is None else scene.scenario.plan.goals
        leads += [
            (f"plan.goals.{name}", goal)
            for name, goal in goals.items()
            if getattr(goal, "tip", None) == grasp.tip.label
            and getattr(goal, "frame", None) == grasp.config.frame
        ]
        for path, lead in leads:
            angles = getattr(lead, "mated_deg", None)
            if angles is None:
                continue
            first, other = (pin.rpy.rpyToMatrix(np.radians(rpy)) for rpy in (angles, capture.mated_deg))
            angle = float(np.degrees(np.linalg.norm(pin.log3(first.T @ other))))
            if angle > capture.misalignment_deg:
                warnings.append(
                    f"{path}.mated_deg: leads {grasp.tip.label} to {_angles(angles)} deg in "
                    f"{grasp.config.frame}, {angle:.4g} deg from {grasp.path}.capture.mated_deg "
                    f"{_angles(capture.mated_deg)}, which closes "
                    f"within misalignment_deg {capture.misalignment_deg:g}"
                )
    return warnings


def _angles(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _centre(scene: Scene, data: pin.Data, body: SceneBody) -> tuple[Array, Array]:
    """Centre of mass of a body [m] and its velocity [m/s]; of a body that is held, its root link and none."""
    if not body.root_joint:
        return np.array(data.oMf[body.root_frame].translation), np.zeros(3)
    masses = np.array([scene.model.inertias[joint].mass for joint in body.subtree])
    places, speeds = [], []
    for joint in body.subtree:
        lever = data.oMi[joint].rotation @ scene.model.inertias[joint].lever
        motion = data.oMi[joint].act(data.v[joint])
        places.append(data.oMi[joint].translation + lever)
        speeds.append(motion.linear + np.cross(motion.angular, places[-1]))
    total = masses.sum()
    return masses @ np.array(places) / total, masses @ np.array(speeds) / total


def _within(scene: Scene, body: SceneBody, frame: int) -> float:
    """Upper bound [m] of the distance of a frame from the reference point :func:`_centre` of its body."""
    model, tip = scene.model, scene.model.frames[frame]
    if not body.root_joint:
        return reach(scene, body, frame)
    lengths = lengths_to_root(scene, body, int(tip.parentJoint), np.array(tip.placement.translation))
    weighed, total = 0.0, 0.0
    for joint in body.subtree:
        inertia = model.inertias[joint]
        other = lengths_to_root(scene, body, joint, np.array(inertia.lever))
        meets = next(ancestor for ancestor in lengths if ancestor in other)
        (one, here), (two, there) = lengths[meets], other[meets]
        weighed += inertia.mass * (one + two + float(np.linalg.norm(here - there)))
        total += inertia.mass
    return weighed / total
