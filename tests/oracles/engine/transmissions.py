"""Transmissions, written again: rotors from Pinocchio's placements, in world axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.section import matching
from spacerobot.elements.actuators.transmission import Transmission
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.actuation import Delivered, Now, Push, Stored, delivery_of
from tests.oracles.engine.kinematics import Kinematics


@dataclass(frozen=True)
class Gears:
    """Motors of one section, one for each of n joints."""

    body: SceneBody
    config: Transmission
    key: str
    joints: tuple[int, ...]
    columns: tuple[int, ...]
    passes_on: tuple[int, ...] = ()
    works: tuple[str, ...] = ("transmission",)
    from_outside: bool = False

    @property
    def state_names(self) -> tuple[str, ...]:
        """Momenta, then deflections."""
        name, places = f"{self.body.name}/{self.key.rpartition('.')[2]}", range(len(self.joints))
        return tuple(f"{name}.{what}[{i}]" for what in ("momentum", "deflection") for i in places)

    def _carriers(self, kinematics: Kinematics) -> tuple[Array, Array]:
        """Axes of joints, angular velocities of the links that carry rotors (n, 3) each, world axes."""
        model, data = kinematics.model, kinematics.data
        axes, spins = [], []
        for joint in self.joints:
            jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            own = jacobian[:, model.idx_vs[joint]]
            axes.append(own[3:] if np.any(own[3:]) else own[:3])
            parent = model.parents[joint]
            spins.append(data.oMi[parent].rotation @ data.v[parent].angular if parent else np.zeros(3))
        return np.array(axes), np.array(spins)

    def initial(self, kinematics: Kinematics) -> Array:
        """Rotors as fast as their joints, nothing deflected."""
        axes, spins = self._carriers(kinematics)
        rates = kinematics.v[list(self.columns)]
        first = self.config.inertia * (self.config.ratio * rates + np.sum(axes * spins, axis=1))
        return np.concatenate([first, np.zeros(len(rates))])

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """Torques of springs on the joints, and what the carriers take."""
        del now
        config, columns = self.config, list(self.columns)
        momentum, deflection = np.split(states, 2)
        axes, spins = self._carriers(kinematics)
        rates = kinematics.v[columns]
        speed = momentum / config.inertia - np.sum(axes * spins, axis=1)
        twisting = speed / config.ratio - rates
        spring = config.stiffness * deflection + config.damping * twisting
        low = config.coulomb + config.stribeck * np.exp(-((speed / config.stribeck_speed) ** 2))
        friction = config.viscous * speed + low * speed / np.hypot(speed, config.coulomb_speed)
        most = np.inf if config.torque_limit is None else config.torque_limit
        motor = np.clip(asked[columns] / config.ratio, -most, most)
        net = motor - spring / config.ratio - friction
        torque = asked.copy()
        torque[columns] = spring
        whole = axes * momentum[:, None]
        pushes = [
            Push(
                kinematics.model.parents[joint],
                np.zeros(3),
                -axes[i] * net[i] - np.cross(spins[i], whole[i]),
                np.array(kinematics.data.oMi[joint].translation),
            )
            for i, joint in enumerate(self.joints)
            if kinematics.model.parents[joint]
        ]
        kinetic = float(momentum @ momentum) / (2 * config.inertia)
        return Delivered(
            torque,
            inner=pushes,
            rates=np.concatenate([net, twisting]),
            power=float(motor @ speed - spring @ rates),
            taken={"transmission": float(friction @ speed + config.damping * twisting @ twisting)},
            stored=[Stored(self.body.name, whole.sum(axis=0), kinetic)],
        )


@delivery_of.register
def _(actuator: Transmission, scene: Scene, body: SceneBody, key: str) -> Gears:
    by_name = {body.joint_name(scene.model, joint): joint for joint in body.driven_joints}
    joints = tuple(by_name[name] for name in matching(tuple(by_name), actuator.joints))
    return Gears(body, actuator, key, joints, tuple(int(scene.model.idx_vs[joint]) for joint in joints))
