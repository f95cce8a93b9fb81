"""Rigid-body model of the target for filters."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacerobot.elements.estimators.estimator import TargetModel
from spacerobot.scene.scene import Scene


def target_model(scene: Scene) -> TargetModel | None:
    """Mass properties and frames of a floating target at the start; None if there is no floating target."""
    body, model = scene.target, scene.model
    if body is None or not body.root_joint:
        return None
    data = model.createData()
    pin.crba(model, data, scene.q)  # which leaves the inertias of subtrees in their roots' axes
    pin.framesForwardKinematics(model, data, scene.q)
    root, inertia = data.oMf[body.root_frame], data.Ycrb[body.root_joint]
    joint = root.actInv(data.oMi[body.root_joint])
    moments, axes = np.linalg.eigh(joint.rotation @ inertia.inertia @ joint.rotation.T)
    axes = axes * np.sign(np.linalg.det(axes))
    links = {
        link.name: int(model.getFrameId(f"target/{link.name}", pin.FrameType.BODY))
        for link in body.description.links
    }
    poses = {name: root.actInv(data.oMf[frame]) for name, frame in links.items()}
    return TargetModel(
        body.root_frame,
        links,
        float(inertia.mass),
        moments,
        np.array(joint.act(inertia.lever)),
        axes,
        {name: (pose.rotation, pose.translation) for name, pose in poses.items()},
    )
