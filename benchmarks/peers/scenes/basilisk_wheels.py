"""A rigid hub with four wheels under constant torques: Basilisk's ``reactionWheelStateEffector``."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.basilisk import (
    BasiliskModel,
    basilisk_side,
    driven,
    hub_state,
    our_hub,
    rigid_hub,
    spacecraft,
)
from benchmarks.peers.compare import Outcome, PeerScene, compare
from spacerobot.common.arrays import Array

DURATION, TOLERANCE = 300.0, 1e-7
TORQUE = (0.03, -0.02, 0.025)


def measure() -> Outcome:
    """Both take the same torques of the motors."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector

    scene = rigid_hub(driven(TORQUE), DURATION)
    storage = scene.robots[0].config.actuators["wheels"].momentum_storage()
    first = scene.model.nq + scene.model.nv

    def speeds(x: Array) -> Array:
        spin = x[scene.model.nq + 3 : scene.model.nq + 6]
        return np.asarray(x[first : first + len(storage.speeds)] / storage.inertia - storage.axes.T @ spin)

    def build() -> BasiliskModel:
        # of balanced wheels, Basilisk counts the inertia to the hub's
        body = spacecraft(scene, storage.inertia * storage.axes @ storage.axes.T)
        wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        for axis, speed in zip(storage.axes.T, storage.speeds, strict=True):
            across = np.linalg.svd(axis[None])[2][1]
            one = reactionWheelStateEffector.RWConfigPayload()
            one.gsHat_B, one.w2Hat0_B = axis[:, None].tolist(), across[:, None].tolist()
            one.w3Hat0_B = np.cross(axis, across)[:, None].tolist()
            one.rWB_B = scene.model.inertias[1].lever[:, None].tolist()
            one.Js, one.Omega, one.u_max, one.RWModel = storage.inertia, speed, -1, messaging.BalancedWheels
            wheels.addReactionWheel(one)
        message, payload = messaging.ArrayMotorTorqueMsg(), messaging.ArrayMotorTorqueMsgPayload()
        payload.motorTorque = (-np.linalg.pinv(storage.axes) @ TORQUE).tolist()
        message.write(payload)
        wheels.rwMotorCmdInMsg.subscribeTo(message)
        body.addStateEffector(wheels)

        def state() -> Array:
            return hub_state(body, wheels.rwSpeedOutMsg.read().wheelSpeeds[: len(storage.speeds)])

        return BasiliskModel(body, state, after=(wheels,), references=(message,))

    return compare(our_hub(scene, 2.0, speeds), basilisk_side(build, 2.0, DURATION), TOLERANCE)


SCENE = PeerScene(
    "Basilisk",
    "bsk",
    "hub with four reaction wheels, 300 s",
    "`reactionWheelStateEffector`, balanced wheels",
    measure,
)
