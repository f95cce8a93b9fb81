"""Resolved rates of a robot whose base reacts, by least squares in null spaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space

from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.resolved_rate import ResolvedRate
from spacerobot.scene import Scene, SceneBody, SceneTip
from tests.oracles.engine.actuation import base_columns
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.references import Motion
from tests.oracles.engine.robot_law import Asked, Asking, RobotLaw, robot_law
from tests.oracles.engine.sensing import reading_of, sensors_of


@dataclass(frozen=True)
class _Task:
    """Jacobian with respect to v (k, nv), what v and v' shall be along it (k,), and the drift (k,)."""

    jacobian: Array
    velocity: Array
    acceleration: Array
    drift: Array
    now: Array
    damping: float = 0.0


@dataclass(frozen=True)
class RateResolver:
    """Resolved rates of one robot."""

    scene: Scene
    body: SceneBody
    config: ResolvedRate
    state_names: ClassVar[tuple[str, ...]] = ()
    ends: ClassVar[tuple[float, ...]] = ()

    def initial(self, kinematics: Kinematics) -> Array:
        """No states."""
        del kinematics
        return np.empty(0)

    def ask(self, now: Asking, states: Array) -> Asked:
        """Torques by inverse dynamics."""
        kinematics, model = now.kinematics, now.kinematics.model
        spread, v = self.scene.spread, kinematics.v
        joints = [int(model.idx_vs[joint]) for joint in self.body.driven_joints]
        base = list(base_columns(self.scene, self.body))
        inertia = spread.T @ kinematics.inertia @ spread
        bias = spread.T @ pin.nonLinearEffects(model, model.createData(), kinematics.q, v)
        if self.config.payload_mass:
            # what a body welded to the tip adds
            loaded, q = self._loaded(model), kinematics.q
            upper = np.triu(pin.crba(loaded, loaded.createData(), q) - pin.crba(model, model.createData(), q))
            inertia = inertia + spread.T @ (upper + np.triu(upper, 1).T) @ spread
            bias = spread.T @ pin.nonLinearEffects(loaded, loaded.createData(), q, v)
        # velocities and accelerations of base and joints from those of the joints
        carried = np.zeros((model.nv, len(joints)))
        carried[joints] = np.eye(len(joints))
        falling = np.zeros(model.nv)
        if base:
            carried[base] = -np.linalg.solve(inertia[np.ix_(base, base)], inertia[np.ix_(base, joints)])
            falling[base] = -np.linalg.solve(inertia[np.ix_(base, base)], bias[base])
        tasks, rates = self._tasks(now, base), v[joints]
        wanted, ahead = np.zeros(len(joints)), np.zeros(len(joints))
        free = np.eye(len(joints))
        for task in tasks:
            rows = task.jacobian @ spread @ carried
            missing = task.velocity - task.now + rows @ rates
            wanted = wanted + _within(rows, free, missing - rows @ wanted, task.damping)
            missing = task.acceleration - task.drift - task.jacobian @ spread @ falling
            ahead = ahead + _within(rows, free, missing - rows @ ahead, task.damping)
            free = free @ null_space(rows @ free)
        sensor = reading_of(sensors_of(self.body).joint_rate)
        read = sensor.offset + sensor.scale * rates
        asked = carried @ (ahead + self.config.rate_gain * (wanted - read)) + falling
        torque = np.zeros(model.nv)
        torque[joints] = (inertia @ asked + bias)[joints] + self._resistance() * rates
        return Asked(torque, states)

    def _loaded(self, model: pin.Model) -> pin.Model:
        """The model with the payload welded to the robot's first tip."""
        config, loaded = self.config, model.copy()
        tip = next(tip for tip in self.scene.tips if tip.body.name == self.body.name)
        ixx, iyy, izz, ixy, ixz, iyz = config.payload_inertia
        about = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        part = config.payload_fraction
        body = pin.Inertia(part * config.payload_mass, np.array(config.payload_com), part * about)
        frame = model.frames[tip.frame]
        loaded.inertias[frame.parentJoint] += frame.placement.act(body)
        return loaded

    def _resistance(self) -> Array:
        names = [self.body.joint_name(self.scene.model, joint) for joint in self.body.driven_joints]
        return np.array([self.body.config.joints[name].damping or 0.0 for name in names])

    def _tasks(self, now: Asking, base: list[int]) -> list[_Task]:
        """What comes first, and then the tips' motions together."""
        kinematics, found = now.kinematics, []
        if self.config.keeps != "nothing":
            kept = base[2 if len(base) == 3 else 3 :] if self.config.keeps == "attitude" else base
            none = np.zeros(len(kept))
            found.append(_Task(np.eye(len(kinematics.v))[kept], none, none, none, kinematics.v[kept]))
        tips = [tip for tip in self.scene.tips if tip.body.name == self.body.name]
        parts = [self._tip(kinematics, tip, now.motions[tip.label]) for tip in tips]
        if parts:
            jacobian, *others = (np.concatenate(column) for column in zip(*parts, strict=True))
            velocity, acceleration, drift, rate = others
            found.append(_Task(jacobian, velocity, acceleration, drift, rate, self.config.damping))
        return found

    def _tip(self, kinematics: Kinematics, tip: SceneTip, motion: Motion) -> tuple[Array, ...]:
        """Jacobian, wanted velocity and acceleration, drift and velocity of a tip's led directions."""
        scene, gain, frame = self.scene, self.config.gain, kinematics.frame(tip.frame)
        sensors = sensors_of(self.body)
        axes = [*scene.translation_axes, *(a + 3 for a in scene.rotation_axes if self.config.orientation)]

        def read(signal: str, value: Array) -> Array:
            sensor = reading_of(sensors[signal])
            return sensor.offset + sensor.scale * value

        turned = rotation_vector(frame.rotation, motion.rotation)
        error = np.concatenate(
            [motion.position - read("tip_position", frame.position), -read("tip_orientation", turned)]
        )
        now = np.concatenate(
            [
                read("tip_velocity", frame.velocity[:3]),
                read("tip_angular_velocity", frame.velocity[3:]),
            ]
        )
        velocity = np.concatenate([motion.velocity, motion.angular_velocity])
        acceleration = np.concatenate([motion.acceleration, motion.angular_acceleration])
        found = (
            frame.jacobian,
            velocity + gain * error,
            acceleration + gain * (velocity - now),
            frame.drift,
            now,
        )
        return tuple(part[axes] for part in found)


def _within(rows: Array, free: Array, missing: Array, damping: float) -> Array:
    """Least squares of ``rows r = missing`` with r = free y, and of damping times y."""
    inside = rows @ free
    matrix = np.vstack([inside, damping * np.eye(inside.shape[1])])
    right = np.concatenate([missing, np.zeros(inside.shape[1])])
    found: Array = free @ np.linalg.lstsq(matrix, right, rcond=None)[0]
    return found


@robot_law.register
def _(controller: ResolvedRate, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    del key
    return RateResolver(scene, body, controller)
