"""Joint PD towards the inverse kinematics of the references (Eq. 34, Fig. 1).

    tau_i = K_p2 (theta_d,i - theta_i) - K_d2 theta_i'

The robot finds theta_d by resolved rates in a model of itself whose base stands where it began.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.joint_pd import JointPd
from spacerobot.elements.controllers.policy import Policy
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.references import Motion
from tests.oracles.engine.robot_law import Asked, Asking, RobotLaw, robot_law
from tests.oracles.engine.sensing import reading_of, sensors_of
from tests.oracles.engine.tip_control import Channel, Command


@dataclass(frozen=True)
class _Joints:
    """A controller of the joints of one robot."""

    scene: Scene
    body: SceneBody

    ends: ClassVar[tuple[float, ...]] = ()

    @property
    def _columns(self) -> list[int]:
        """Places of its free joints in v."""
        return [int(self.scene.model.idx_vs[joint]) for joint in self.body.driven_joints]

    def positions(self, q: Array) -> Array:
        """Joint positions (n,) [rad or m]; of an unbounded joint between -pi and pi."""
        return np.array([angle_of(self.scene.model.joints[j], q) for j in self.body.driven_joints])

    def _read(self, kinematics: Kinematics, wanted: Array) -> tuple[Array, Array]:
        """Measured positions and rates of its joints (n,), unbounded ones nearest to the wanted positions."""
        sensors = sensors_of(self.body)
        angles, rates = reading_of(sensors.joint_position), reading_of(sensors.joint_rate)
        position = self._nearest_positions(kinematics.q, wanted)
        return (
            angles.offset + angles.scale * position,
            rates.offset + rates.scale * kinematics.v[self._columns],
        )

    def _effort(self, values: Array) -> Array:
        """Generalized forces (nv,) of those of its joints (n,)."""
        torque = np.zeros(self.scene.model.nv)
        torque[self._columns] = values
        return torque

    def _nearest_positions(self, q: Array, desired: Array) -> Array:
        """Joint positions (n,), unbounded ones by whole turns as near as may be to the desired ones."""
        unbounded = np.array(
            [self.scene.model.joints[j].nq == 2 for j in self.body.driven_joints], dtype=bool
        )
        found = self.positions(q)
        turns = np.round((desired - found) / (2 * np.pi))
        nearest: Array = found + np.where(unbounded, 2 * np.pi * turns, 0.0)
        return nearest


@dataclass(frozen=True)
class JointController(_Joints):
    """Joint PD of one robot; its states are the desired joint positions."""

    key: str
    config: JointPd

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        name = f"{self.body.name}/{self.key.rpartition('.')[2]}.theta_d"
        return tuple(f"{name}[{i}]" for i in range(len(self.body.driven_joints)))

    def initial(self, kinematics: Kinematics) -> Array:
        """Joint positions (n,)."""
        return self.positions(kinematics.q)

    def ask(self, now: Asking, states: Array) -> Asked:
        """Torques of Eq. 34, and rates of the desired joint positions (n,)."""
        angle, rate = self._read(now.kinematics, states)
        torque = self.config.kp * (states - angle) - self.config.kd * rate
        rates = self._desired_rate(states, now.motions)
        return Asked(self._effort(torque), rates, self.config.null_space)

    def _desired_rate(self, desired: Array, motions: Mapping[str, Motion]) -> Array:
        """Rate of the desired joint positions (n,), by damped least squares."""
        scene, model = self.scene, self.scene.model
        kinematics = Kinematics(model, self._imagined(desired), np.zeros(model.nv))
        rows: list[Array] = [np.empty((0, model.nv))]
        wanted: list[Array] = [np.empty(0)]
        for tip in scene.tips:
            if tip.body is not self.body:
                continue
            frame, motion = kinematics.frame(tip.frame), motions[tip.label]
            axes = list(scene.translation_axes)
            rows.append(frame.jacobian[axes])
            gap = motion.position - frame.position
            wanted.append((motion.velocity + self.config.ik_rate * gap)[axes])
            if tip.config.orientation_pid is not None:
                axes = list(scene.rotation_axes)
                rows.append(frame.jacobian[3:][axes])
                gap = rotation_vector(motion.rotation, frame.rotation)
                wanted.append((motion.angular_velocity + self.config.ik_rate * gap)[axes])
        jacobian = (np.vstack(rows) @ scene.spread)[:, self._columns]
        gram = jacobian @ jacobian.T + self.config.ik_damping**2 * np.eye(len(jacobian))
        rate: Array = jacobian.T @ np.linalg.solve(gram, np.concatenate(wanted))
        return rate

    def _imagined(self, desired: Array) -> Array:
        """Configuration with the desired joint positions and everything else where it began."""
        q = np.array(self.scene.q)
        positions = dict(zip(self.body.driven_joints, desired, strict=True))
        for tie in self.body.ties:
            if tie.leader in positions:
                positions[tie.joint] = tie.multiplier * positions[tie.leader] + tie.offset
        for joint, value in positions.items():
            _set_position(self.scene.model.joints[joint], value, q)
        return q


def angle_of(joint: Any, q: Array) -> float:
    if joint.nq == 2:
        return float(np.arctan2(q[joint.idx_q + 1], q[joint.idx_q]))
    return float(q[joint.idx_q])


def _set_position(joint: Any, value: float, q: Array) -> None:
    q[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if joint.nq == 2 else value


@dataclass(frozen=True)
class HeldTorques(_Joints):
    """Joint torques that are held: states without a rate; without a wrench on the base."""

    key: str

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        return tuple(f"{self.body.name}/{self.key}.held[{i}]" for i in range(len(self.body.driven_joints)))

    def initial(self, kinematics: Kinematics) -> Array:
        """None yet (n,)."""
        del kinematics
        return np.zeros(len(self.body.driven_joints))

    def ask(self, now: Asking, states: Array) -> Asked:
        """The torques (nv,), and zero rates (n,)."""
        del now
        return Asked(self._effort(states), np.zeros(len(states)))


@robot_law.register
def _(controller: Policy, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    del controller
    return HeldTorques(scene, body, key.rpartition(".")[2])


@robot_law.register
def _(controller: JointPd, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    return JointController(scene, body, key, controller)


def null_space(
    kinematics: Kinematics,
    torque: Array,
    body: SceneBody,
    channels: Sequence[tuple[Channel, Command]],
    spread: Array,
) -> Array:
    """Torque without the part that accelerates the robot's controlled tips, as their feedback sees it.

    ``tau - J^T F`` with the tip forces F that cancel the acceleration ``C M^-1 tau``, M being that of the
    free joints.
    """
    own = [command for channel, command in channels if channel.tip.body is body]
    if not own:
        return torque
    feedback = np.vstack([command.feedback for command in own])
    actuation = np.vstack([command.jacobian for command in own]).T
    free = spread[:, np.diag(spread) > 0]
    inverse = free @ np.linalg.solve(free.T @ kinematics.inertia @ free, free.T)
    force = np.linalg.solve(feedback @ inverse @ actuation, feedback @ inverse @ torque)
    projected: Array = torque - actuation @ force
    return projected
