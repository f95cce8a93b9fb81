"""Reaction wheels, written again: torques by numpy's pseudo-inverse, momentum and wrenches in world axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from spacerobot.common.arrays import Array
from spacerobot.elements.actuators.reaction_wheels import ReactionWheels
from spacerobot.elements.actuators.wheel_joints import WheelJoints
from spacerobot.elements.actuators.wheel_set import PULL, SLACK, WheelSet
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.actuation import (
    Delivered,
    Now,
    Push,
    Stored,
    Turn,
    base_columns,
    delivery_of,
)
from tests.oracles.engine.kinematics import Kinematics


@dataclass(frozen=True)
class Wheels:
    """Wheels of one section; those that are joints have columns of their own, the others states.

    Attributes:
        axes: Of the wheels (n, 3), root link's axes.
        inertia, resistance: Of each about its axis (n,) [kg m^2], and by its joint (n,) [N m s/rad].
    """

    scene: Scene
    body: SceneBody
    config: WheelSet
    key: str
    axes: Array
    inertia: Array
    own: tuple[int, ...]
    resistance: Array

    @property
    def from_outside(self) -> bool:
        """Nothing of it: what the base takes, the wheels lose."""
        return False

    @property
    def passes_on(self) -> tuple[int, ...]:
        """Places in v of the base's angular velocity."""
        columns = base_columns(self.scene, self.body)
        return tuple(columns[-1:] if len(columns) == 3 else columns[3:])

    @property
    def columns(self) -> tuple[int, ...]:
        """Those and the wheels' own."""
        return (*self.passes_on, *self.own)

    @property
    def works(self) -> tuple[str, ...]:
        """The work of friction, where there is any that is not a joint's resistance."""
        return ("wheel_friction",) if self.config.coulomb or self._viscous else ()

    @property
    def state_names(self) -> tuple[str, ...]:
        """Angular momenta of wheels that are no joints."""
        return () if self.own else tuple(f"{self._name}.momentum[{i}]" for i in range(len(self.axes)))

    @property
    def _name(self) -> str:
        return f"{self.body.name}/{self.key.rpartition('.')[2]}"

    @property
    def _viscous(self) -> float:
        return self.config.viscous if isinstance(self.config, ReactionWheels) else 0.0

    def _carried(self, kinematics: Kinematics) -> Array:
        """Part of the base's spin about each wheel's axis (n,) [rad/s]."""
        frame = kinematics.frame(self.body.root_frame)
        found: Array = self.axes @ frame.rotation.T @ frame.velocity[3:]
        return found

    def initial(self, kinematics: Kinematics) -> Array:
        """Angular momenta at the start."""
        if not isinstance(self.config, ReactionWheels):
            return np.empty(0)
        speeds = np.array(self.config.speeds or np.zeros(len(self.axes)))
        first: Array = self.inertia * (speeds + self._carried(kinematics))
        return first

    def _spins(self, kinematics: Kinematics, states: Array) -> tuple[Array, Array]:
        """Speed [rad/s] and momentum [N m s] of each wheel (n,)."""
        carried = self._carried(kinematics)
        speed = kinematics.v[list(self.own)] if self.own else states / self.inertia - carried
        return speed, self.inertia * (speed + carried)

    def momentum(self, kinematics: Kinematics, states: Array) -> Array:
        """Angular momentum (3,) of all wheels about their axes, world axes [N m s]."""
        own = self._spins(kinematics, states)[1]
        whole: Array = kinematics.frame(self.body.root_frame).rotation @ self.axes.T @ own
        return whole

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """Torques on wheels and base."""
        speed, momentum = self._spins(kinematics, states)
        about, config = list(self.passes_on), self.config
        turned = self.axes[:, -len(about) :]
        held = np.array([f"{self._name}.{i}" in now.on for i in range(len(speed))], dtype=np.bool_)
        rub = config.coulomb * speed / np.hypot(speed, config.coulomb_speed) + self._viscous * speed
        friction = rub + self.resistance * speed
        wanted, pull = self._wanted(turned, held, -asked[about], friction)
        most = np.inf if config.torque_limit is None else config.torque_limit
        command = np.clip(wanted, -most, most)
        turns = list(self._turns(command, friction, speed, pull))
        command = np.where(held, friction, command)  # what a held wheel's motor balances
        net = command - friction
        torque = asked.copy()
        torque[about] += turned.T @ command
        torque[list(self.own)] = (net + friction - rub)[: len(self.own)]
        rotation = kinematics.frame(self.body.root_frame).rotation
        whole = self.momentum(kinematics, states)
        lost, seen = float(rub @ speed), self._seen(net + friction, speed, whole)
        taken = dict.fromkeys(self.works, lost)
        if self.own:
            return Delivered(torque, power=lost, taken=taken, seen=seen, turns=turns)
        spin = kinematics.frame(self.body.root_frame).velocity[3:]
        push = -rotation @ self.axes.T @ net - np.cross(spin, whole)
        frame = kinematics.frame(self.body.root_frame)
        return Delivered(
            torque,
            inner=[Push(self.body.root_joint, np.zeros(3), push, frame.position)],
            rates=net,
            power=float((net + friction) @ speed),
            taken=taken,
            stored=[Stored(self.body.name, whole, float(momentum @ (momentum / self.inertia)) / 2)],
            seen=seen,
            turns=turns,
        )

    def _wanted(
        self, axes: Array, held: NDArray[np.bool_], torque: Array, friction: Array
    ) -> tuple[Array, float]:
        """Torque (n,) of each motor if its wheel were free and the others as they are, and what frees one.

        Motors of other held wheels give their friction, and the pseudo-inverse of the rest of the axes (n, k)
        what is left of the torque (k,). A set that is not redundant leaves out none.
        """
        together, count = np.linalg.pinv(axes.T, rcond=1e-6), len(axes)
        if count <= np.linalg.matrix_rank(axes):
            return together @ torque, 0.0
        wanted = np.empty(count)
        for i in range(count):
            others = held & (np.arange(count) != i)
            rest = torque - axes[others].T @ friction[others]
            wanted[i] = (np.linalg.pinv((axes * ~others[:, None]).T, rcond=1e-6) @ rest)[i]
        return wanted, PULL * float(np.abs(together @ torque - friction).sum())

    def _turns(self, command: Array, friction: Array, speed: Array, pull: float) -> Sequence[Turn]:
        """At which wheels come to their limit, and are free of it."""
        most = self.config.speed_limit
        if most is None:
            return []
        found = []
        for i, (motor, rub, fast) in enumerate(zip(command, friction, speed, strict=True)):
            name, over, faster = f"{self._name}.{i}", abs(fast) / most - 1, (motor - rub) * fast / most
            found += [
                Turn(f"{name}.saturated", "saturated", name, min(over, faster), {name: True}),
                Turn(f"{name}.freed", "freed", name, max(-faster - pull, -SLACK - over), {name: False}),
            ]
        return found

    def _seen(self, torque: Array, speed: Array, momentum: Array) -> dict[tuple[str, str], Array]:
        """What is observed."""
        found = {("wheel_momentum", self.body.name): momentum}
        for i in range(len(speed)):
            name = f"{self._name}.{i}"
            found |= {("wheel_speed", name): speed[i : i + 1], ("wheel_torque", name): torque[i : i + 1]}
            if self.config.speed_limit is not None:
                found["wheel_margin", name] = 1 - np.abs(speed[i : i + 1]) / self.config.speed_limit
        return found


@delivery_of.register
def _(actuator: ReactionWheels, scene: Scene, body: SceneBody, key: str) -> Wheels:
    if actuator.pyramid is None:
        axes = np.array([np.array(axis) / np.linalg.norm(axis) for axis in actuator.axes])
    else:
        tilt, count = np.radians(actuator.pyramid.tilt_deg), actuator.count
        around = 2 * np.pi / count * np.arange(count)
        axes = np.column_stack(
            [np.cos(tilt) * np.cos(around), np.cos(tilt) * np.sin(around), np.full(count, np.sin(tilt))]
        )
    inertia = np.full(len(axes), actuator.inertia)
    return Wheels(scene, body, actuator, key, axes, inertia, (), np.zeros(len(axes)))


@delivery_of.register
def _(actuator: WheelJoints, scene: Scene, body: SceneBody, key: str) -> Wheels:
    by_name = {body.joint_name(scene.model, joint): joint for joint in body.free_joints}
    names = actuator.owns(tuple(by_name))
    axes, inertia = [], []
    for name in names:
        joint, data = by_name[name], scene.model.createData()
        motion = pin.computeJointJacobian(scene.model, data, pin.neutral(scene.model), joint)
        axis = motion[3:, scene.model.idx_vs[joint]]
        axes.append(scene.model.jointPlacements[joint].rotation @ axis)
        inertia.append(axis @ scene.model.inertias[joint].matrix()[3:, 3:] @ axis)
    damping = np.array([body.config.joints[name].damping or 0.0 for name in names])
    own = tuple(int(scene.model.idx_vs[by_name[name]]) for name in names)
    return Wheels(scene, body, actuator, key, np.array(axes), np.array(inertia), own, damping)
