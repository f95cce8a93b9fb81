"""Control of a floating base: PID, and the rate of momentum that is not the base's own.

    u = K_p e + K_i int(e) - K_d w + k (h' - J w')

The robot's momentum changes by what acts on its base: h' are the base's rows of ``M v' + n``, by Pinocchio's
composite-rigid-body and recursive Newton-Euler algorithms, about the centre of mass.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.base_attitude import BaseAttitude
from spacerobot.elements.controllers.base_position import BasePosition
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.actuation import base_columns
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.robot_law import Asked, Asking, robot_law
from tests.oracles.engine.tip_control import Command


@dataclass(frozen=True)
class BaseController:
    """Controller of one base's rotation or translation; its states are the integral of the error."""

    scene: Scene
    body: SceneBody
    config: BaseAttitude | BasePosition
    key: str

    ends: ClassVar[tuple[float, ...]] = ()

    @property
    def axes(self) -> list[int]:
        """World axes of what it holds."""
        turns = isinstance(self.config, BaseAttitude)
        return list(self.scene.rotation_axes if turns else self.scene.translation_axes)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        name = f"{self.body.name}/{self.key.rpartition('.')[2]}"
        kept = ("integral",) * self._integrates + ("filter",) * self._filters
        return tuple(f"{name}.{what}[{i}]" for what in kept for i in range(len(self.axes)))

    @functools.cached_property
    def _integrates(self) -> bool:
        """Whether there is an integral: in all phases or in none, and in none where K_i is zero in all."""
        own = self.scene.scenario
        for one in (own, *(own.during(phase) for phase in own.phases)):
            controller = dict(one.robots[self.body.name].elements()).get(self.key)
            if getattr(controller, "ki", 0.0) != 0:
                return True
        return False

    @property
    def _filters(self) -> bool:
        return self.config.derivative == "filtered" and self.config.feed_forward != 0

    def initial(self, kinematics: Kinematics) -> Array:
        """No error yet, and the filter at what it follows."""
        n = len(self.axes)
        felt = self._reaction(kinematics)[0] @ kinematics.v if self._filters else np.empty(0)
        integral = np.zeros(n * self._integrates)
        return np.concatenate([integral, felt[self.axes] if self._filters else felt])

    def error(self, kinematics: Kinematics) -> Array:
        """Rotation vector [rad] or way [m] to where the base shall be (3,), world axes."""
        now = kinematics.frame(self.body.root_frame)
        first = Kinematics(self.scene.model, np.array(self.scene.q), np.array(self.scene.v))
        start = first.frame(self.body.root_frame)
        if isinstance(self.config, BasePosition):
            given = self.config.position
            return np.array(start.position if given is None else given) - now.position
        if self.config.attitude_deg is None:
            return rotation_vector(start.rotation, now.rotation)
        return rotation_vector(pin.rpy.rpyToMatrix(np.radians(self.config.attitude_deg)), now.rotation)

    def ask(self, now: Asking, states: Array) -> Asked:
        """Command, and rates of the states."""
        command = self._evaluate(now.kinematics, states)
        return Asked(np.zeros(len(now.kinematics.v)), command.rates, command=command)

    def _evaluate(self, kinematics: Kinematics, states: Array) -> Command:
        """Command and rates of the states at one instant."""
        config, axes = self.config, self.axes
        turns, n = isinstance(config, BaseAttitude), len(axes)
        now, error = kinematics.frame(self.body.root_frame), self.error(kinematics)[axes]
        actuation = self._base_jacobian(kinematics)[3:]
        if not turns:
            actuation = self._base_jacobian(kinematics)[:3] - pin.skew(self._lever(kinematics)) @ actuation
        felt, drift = self._reaction(kinematics)
        part, rates = config.feed_forward, [error] if self._integrates else []
        integral = states[:n] if self._integrates else np.zeros(n)
        if self._filters:
            follows = (felt @ kinematics.v)[axes]
            rates.append((follows - states[-n:]) / config.filter_time)
            spin = now.velocity[3:]
            inertia = now.rotation @ self._first_inertia() @ now.rotation.T
            carried = np.cross(spin, inertia @ spin) if turns else np.zeros(3)
            drift, gain = carried[axes] + rates[-1], 0.0
        else:
            drift, gain = drift[axes], -part
        velocity = (now.velocity[3:] if turns else now.velocity[:3])[axes]
        command = config.kp * error + config.ki * integral - config.kd * velocity + part * drift
        return Command(
            actuation[axes], felt[axes], command, gain, -velocity, np.concatenate([np.empty(0), *rates])
        )

    def _base_jacobian(self, kinematics: Kinematics) -> Array:
        """Of the root link, by the base's own columns alone (6, nv)."""
        own, jacobian = base_columns(self.scene, self.body), np.zeros((6, kinematics.model.nv))
        jacobian[:, own] = kinematics.frame(self.body.root_frame).jacobian[:, own]
        return jacobian

    def _reaction(self, kinematics: Kinematics) -> tuple[Array, Array]:
        """Momentum that is not the base's own, by v (3, nv), and its rate without the part by v' (3,)."""
        now = kinematics.frame(self.body.root_frame)
        whole, drift = self._momentum_rate(kinematics, self._base_jacobian(kinematics))
        if isinstance(self.config, BaseAttitude):
            about = np.hstack([-pin.skew(self._lever(kinematics)), np.eye(3)])
            inertia = now.rotation @ self._first_inertia() @ now.rotation.T
            return about @ whole - inertia @ now.jacobian[3:], about @ drift
        mass = self._mass(kinematics)
        return whole[:3] - mass * now.jacobian[:3], drift[:3] - mass * now.drift[:3]

    def _momentum_rate(self, kinematics: Kinematics, jacobian: Array) -> tuple[Array, Array]:
        """Rate of the robot's momentum about the base's origin: by v' (6, nv), and the rest (6,)."""
        model, own = kinematics.model, base_columns(self.scene, self.body)
        bias = pin.nonLinearEffects(model, model.createData(), kinematics.q, kinematics.v)
        return jacobian[:, own] @ kinematics.inertia[own], jacobian[:, own] @ bias[own]

    def _mass(self, kinematics: Kinematics) -> float:
        """Of the robot."""
        return float(sum(kinematics.model.inertias[joint].mass for joint in self.body.subtree))

    def _lever(self, kinematics: Kinematics) -> Array:
        """From the base's origin to the robot's centre of mass (3,), world axes."""
        data, model = kinematics.data, kinematics.model
        total = np.zeros(3)
        for joint in self.body.subtree:
            total += model.inertias[joint].mass * data.oMi[joint].act(model.inertias[joint].lever)
        centre: Array = total / self._mass(kinematics) - kinematics.frame(self.body.root_frame).position
        return centre

    def _first_inertia(self) -> Array:
        """Of the robot about its centre of mass as it begins (3, 3), axes of the base."""
        first = Kinematics(self.scene.model, np.array(self.scene.q), np.array(self.scene.v))
        total = pin.Inertia.Zero()
        for joint in self.body.subtree:
            total += first.data.oMi[joint].act(first.model.inertias[joint])
        rotation = first.frame(self.body.root_frame).rotation
        inertia: Array = rotation.T @ total.inertia @ rotation
        return inertia


@robot_law.register(BaseAttitude)
@robot_law.register(BasePosition)
def _(controller: BaseAttitude | BasePosition, scene: Scene, body: SceneBody, key: str) -> BaseController:
    return BaseController(scene, body, controller, key)
