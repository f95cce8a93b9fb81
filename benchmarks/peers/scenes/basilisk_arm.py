"""A servicer with two moving arms and four wheels in orbit: Basilisk's ``MJScene`` with ``NBodyGravity``."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.basilisk import BasiliskModel, basilisk_side, driven
from benchmarks.peers.compare import Outcome, PeerScene, Side, compare, our_side
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates, mjcf, motors
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 60.0, 1e-6
MU, RADIUS = 3.986004418e14, 6378137.0 + 500e3
TORQUE = (0.3, -0.2, 0.25)


def in_orbit() -> Scene:
    """The servicer without grasps; all joints turn at first."""
    changes: dict[str, object] = driven(TORQUE) | {
        "grasps": {},
        "environment": {"leo": {"kind": "orbit", "altitude": 500e3, "gravity_gradient": False}},
        "target.base": {"joint": "free_flyer", "position": [4.0, 0.0, 0.0]},
        "target.reference": None,
        "robots.servicer.tips": {},
        "simulation.duration": DURATION,
    }
    for side, sign in (("left", 1), ("right", -1)):
        for k in range(1, 8):
            changes[f"robots.servicer.joints.{side}_joint_{k}.rate_deg"] = sign * (3.0 - k)
    return load_scene("servicer", changes)


def measure() -> Outcome:
    """Bodies of Basilisk move about the Earth's centre; compared are the motions relative to the orbit."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import mujoco
    from Basilisk.utilities import simIncludeGravBody

    scene = in_orbit()
    storage = scene.robots[0].config.actuators["wheels"].momentum_storage()
    count = len(storage.speeds)
    names = [f"wheel_{i}" for i in range(count)]
    text = mjcf(scene, wheels={1: (storage.axes, storage.inertia)}, more=motors(names))
    commands = -np.linalg.pinv(storage.axes) @ TORQUE

    def moved(position: Array, velocity: Array, t: float, sign: int) -> tuple[Array, Array]:
        """From the orbit's origin to the Earth's centre (or back) at a time."""
        rate = np.sqrt(MU / RADIUS**3)
        c, s = np.cos(rate * t), np.sin(rate * t)
        position, velocity = position.copy(), velocity.copy()
        for joint in scene.model.joints[1:]:
            if joint.nv == 6:
                k, n = joint.idx_q, joint.idx_v
                position[k : k + 2] += sign * RADIUS * np.array([c, s])
                velocity[n : n + 2] += sign * RADIUS * rate * np.array([-s, c])
        return position, velocity

    def build() -> BasiliskModel:
        """The scene, its gravity and motors."""
        body = mujoco.MJScene(text)
        gravity = simIncludeGravBody.gravBodyFactory()
        earth = gravity.createEarth()
        earth.isCentralBody, earth.mu = True, MU
        gravity.addBodiesTo(body)
        messages = []
        for name, command in zip(names, commands, strict=True):
            messages.append(messaging.SingleActuatorMsg())
            messages[-1].write(messaging.SingleActuatorMsgPayload(input=command))
            body.getSingleActuator(name).actuatorInMsg.subscribeTo(messages[-1])

        def start() -> None:
            position, velocity = moved(*coordinates(scene, scene.q, scene.v), 0, 1)
            for name, joint in zip(
                scene.model.names.tolist()[1:], scene.model.joints.tolist()[1:], strict=True
            ):
                own, x, v = body.getBody(name), position[joint.idx_q :], velocity[joint.idx_v :]
                if joint.nv == 6:
                    own.setPosition(x[:3])
                    own.setVelocity(v[:3])
                    own.setAttitude(x[4:7] / (1 + x[3]))
                    own.setAttitudeRate(v[3:6])
                else:
                    own.getScalarJoint(name).setPosition(x[0])
                    own.getScalarJoint(name).setVelocity(v[0])
            for name, speed in zip(names, storage.speeds, strict=True):
                body.getBody(name).getScalarJoint(name).setVelocity(speed)

        def state() -> Array:
            state_message = body.stateOutMsg.read()
            position = np.delete(np.ravel(state_message.qpos), range(7, 7 + count))
            velocity = np.ravel(state_message.qvel)
            reduced_velocity = np.delete(velocity, range(6, 6 + count))
            return np.concatenate([*moved(position, reduced_velocity, DURATION, -1), velocity[6 : 6 + count]])

        return BasiliskModel(body, state, references=(gravity, *messages), start=start)

    return compare(our_wheeled(scene, 0.08), basilisk_side(build, 0.02, DURATION), TOLERANCE)


def our_wheeled(scene: Scene, step_s: float) -> Side:
    """Ours, with the final state in MuJoCo's coordinates and the wheels' speeds."""
    storage = scene.robots[0].config.actuators["wheels"].momentum_storage()
    count, nq, nv = len(storage.speeds), scene.model.nq, scene.model.nv

    def state(x: Array) -> Array:
        q, v, rest = x[:nq], x[nq : nq + nv], x[nq + nv :]
        speeds = rest[:count] / storage.inertia - storage.axes.T @ v[3:6]
        return np.concatenate([*coordinates(scene, q, v), speeds])

    return our_side(scene, step_s, state)


SCENE = PeerScene(
    "Basilisk",
    "bsk",
    "servicer (two arms, four wheels) and satellite in orbit, 60 s",
    "`MJScene` with `NBodyGravity`",
    measure,
)
