"""What actuators of joints deliver."""

from __future__ import annotations

import functools

import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements import Actuator
from spacerobot.elements.actuators.torque_limit import TorqueLimit
from spacerobot.pinocchio_engine.laws import refusal
from spacerobot.scenario import Robot
from spacerobot.scene import Scene, SceneBody


@functools.singledispatch
def greatest_torques(actuator: Actuator, scene: Scene, body: SceneBody) -> Array:
    """Greatest torque that an actuator delivers at each place of v (nv,), infinite where it has no part."""
    del scene, body
    raise refusal(actuator)


@greatest_torques.register
def _(actuator: TorqueLimit, scene: Scene, body: SceneBody) -> Array:
    found = np.full(scene.model.nv, np.inf)
    by_name = {body.joint_name(scene.model, joint): joint for joint in body.free_joints}
    for name in actuator.limits(tuple(by_name)):
        most = body.config.joints[name].torque_limit if actuator.limit is None else actuator.limit
        found[scene.model.idx_vs[by_name[name]]] = np.inf if most is None else most
    return found


def torque_limits(scene: Scene) -> Array:
    """Greatest torque of each velocity component (nv,), infinite where there is none."""
    found = [np.full(scene.model.nv, np.inf)]
    for body in scene.robots:
        if isinstance(body.config, Robot):
            found += [greatest_torques(actuator, scene, body) for _, actuator in body.config.driven_by()]
    limits: Array = np.min(found, axis=0)
    return limits
