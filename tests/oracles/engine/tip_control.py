"""Control of a tip: PID on the velocity error, amnesia controller, sensors (Eq. 26-30, 35-38).

X_ta' = -t_a X_ta + (X_ref - X_tip)              Eq. 37, 38
e_v   = x_ref' + G_e X_ta - v_feedback
u     = K_p e_v + K_i int(e_v) + K_d d(e_v)/dt   Eq. 35
tau   = J^T u
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.elements import TipController
from spacerobot.elements.controllers.amnesia import Amnesia
from spacerobot.elements.controllers.payload_feed_forward import PayloadFeedForward
from spacerobot.elements.controllers.pid import Pid
from spacerobot.pinocchio_engine.mechanical_state import FrameMotion
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene, SceneBody, SceneTip
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.laws import refusal
from tests.oracles.engine.references import Motion
from tests.oracles.engine.sensing import reading_of, sensors_of


@dataclass(frozen=True)
class Command:
    """What a channel asks for at one instant: ``u = command - gain (feedback v')``, torques ``J^T u``.

    Attributes
    ----------
    jacobian, feedback
        (n, nv) each.
    command
        (n,).
    gain
        K_d of an ideal derivative, zero of a filtered one.
    velocity_error
        e_v (n,).
    rates
        Rates of the channel's states, in their order.
    """

    jacobian: Array
    feedback: Array
    command: Array
    gain: float
    velocity_error: Array
    rates: Array


@dataclass(frozen=True)
class Channel:
    """The translation or the rotation of one tip, controlled.

    Attributes
    ----------
    rows
        Its rows of a Jacobian: 0 to 2 of a translation, 3 to 5 of a rotation.
    columns
        Places of the arm's joints in v.
    spread
        Velocities of all joints from those of the free ones (nv, nv).
    """

    tip: SceneTip
    key: str
    pid: Pid
    amnesia: Amnesia | None
    sensors: Sensors
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    spread: Array

    @property
    def rotation(self) -> bool:
        """Whether it controls the rotation."""
        return self.rows[0] >= 3

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        label, n = self.tip.label, range(len(self.rows))
        memory = "orientation_amnesia" if self.rotation else "amnesia"
        further = f"{self.key}." if self.key.startswith("controllers.") else ""
        blocks = [f"{label}/{further}{memory}"] if self.amnesia else []
        blocks.append(f"{label}/{self.key}.integral")
        if self.pid.derivative == "filtered":
            blocks.append(f"{label}/{self.key}.filter")
        return tuple(f"{block}[{i}]" for block in blocks for i in n)

    def initial(self, kinematics: Kinematics, motion: Motion) -> Array:
        """States at the start: zero, the filter's input for the filter."""
        states = np.zeros(len(self.state_names))
        if self.pid.derivative == "filtered":
            states[-len(self.rows) :] = self.evaluate(kinematics, motion, states).velocity_error
        return states

    def evaluate(self, kinematics: Kinematics, motion: Motion, states: Array) -> Command:
        """Command and rates of the states at one instant."""
        frame, rows = kinematics.frame(self.tip.frame), list(self.rows)
        jacobian = np.zeros((len(rows), kinematics.model.nv))
        jacobian[:, self.columns] = frame.jacobian[rows][:, self.columns]
        jacobian = jacobian @ self.spread
        feedback, velocity, drift = self._measured_velocity(kinematics, frame, jacobian)
        wanted, wanted_rate = self._wanted(motion)
        parts = iter(states.reshape(-1, len(rows)))
        rates = []
        if self.amnesia is not None:
            memory = next(parts)
            memory_rate = -self.amnesia.ta * memory + self._position_error(frame, motion)
            wanted, wanted_rate = (
                wanted + self.amnesia.ge * memory,
                wanted_rate + self.amnesia.ge * memory_rate,
            )
            rates.append(memory_rate)
        error = wanted - velocity
        rates.append(error)
        command, gain = self.pid.kp * error + self.pid.ki * next(parts), self.pid.kd
        if self.pid.derivative == "ideal":
            command = command + gain * (wanted_rate - drift)
        else:
            slope = (error - next(parts)) / self.pid.filter_time
            command, gain = command + gain * slope, 0.0
            rates.append(slope)
        return Command(jacobian, feedback, command, gain, error, np.concatenate(rates))

    def _measured_velocity(
        self, kinematics: Kinematics, frame: FrameMotion, jacobian: Array
    ) -> tuple[Array, Array, Array]:
        """(feedback, w, drift): fed-back velocity w and its rate ``w' = feedback v' + drift``."""
        rows = list(self.rows)
        if self.pid.feedback == "inertial":
            name = "tip_angular_velocity" if self.rotation else "tip_velocity"
            sensor = reading_of(self.sensors[name])
            velocity = sensor.offset + sensor.scale * frame.velocity[rows]
            return sensor.scale * frame.jacobian[rows], velocity, sensor.scale * frame.drift[rows]
        sensor = reading_of(self.sensors.joint_rate)
        measured = np.zeros(kinematics.model.nv)
        columns = list(self.columns)
        measured[columns] = sensor.offset + sensor.scale * kinematics.v[columns]
        measured = self.spread @ measured  # joints that mimic are not measured, but told by those they follow
        # the robot multiplies what it measures by J, which turns with the base
        return sensor.scale * jacobian, jacobian @ measured, frame.jacobian_rate[rows] @ measured

    def _wanted(self, motion: Motion) -> tuple[Array, Array]:
        axes = [row % 3 for row in self.rows]
        if self.rotation:
            return motion.angular_velocity[axes], motion.angular_acceleration[axes]
        return motion.velocity[axes], motion.acceleration[axes]

    def _position_error(self, frame: FrameMotion, motion: Motion) -> Array:
        """Reference minus measurement, of the position or as a rotation vector."""
        axes = [row % 3 for row in self.rows]
        if not self.rotation:
            sensor = reading_of(self.sensors.tip_position)
            return (motion.position - (sensor.offset + sensor.scale * frame.position))[axes]
        sensor = reading_of(self.sensors.tip_orientation)
        signal = rotation_vector(frame.rotation, motion.rotation)  # tip relative to reference
        return -(sensor.offset + sensor.scale * signal)[axes]


@dataclass(frozen=True)
class Payload:
    """Wrench that a body at the tip takes to move as the reference does, by Pinocchio's spatial algebra."""

    tip: SceneTip
    config: PayloadFeedForward
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    spread: Array
    state_names: tuple[str, ...] = ()

    def initial(self, kinematics: Kinematics, motion: Motion) -> Array:
        """No states."""
        del kinematics, motion
        return np.zeros(0)

    def evaluate(self, kinematics: Kinematics, motion: Motion, states: Array) -> Command:
        """The wrench, as a command without feedback."""
        del states
        mass, com, inertia = self.config.mass, self.config.com, self.config.inertia
        assert mass is not None
        assert com is not None
        assert inertia is not None
        xx, yy, zz, xy, xz, yz = inertia
        body = pin.Inertia(mass, np.array(com), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        axes = motion.rotation
        twist = pin.Motion(axes.T @ motion.velocity, axes.T @ motion.angular_velocity)
        gravity = kinematics.model.gravity.linear
        classical = axes.T @ (motion.acceleration - gravity)
        spatial = pin.Motion(
            classical - np.cross(twist.angular, twist.linear), axes.T @ motion.angular_acceleration
        )
        wrench = body * spatial + twist.cross(body * twist)
        command = self.config.feed_forward * np.concatenate([axes @ wrench.linear, axes @ wrench.angular])
        rows = list(self.rows)
        jacobian = np.zeros((len(rows), kinematics.model.nv))
        jacobian[:, self.columns] = kinematics.frame(self.tip.frame).jacobian[rows][:, self.columns]
        none = np.zeros((len(rows), kinematics.model.nv))
        return Command(jacobian @ self.spread, none, command[rows], 0.0, np.zeros(0), np.zeros(0))


def arm_columns(model: object, body: SceneBody) -> tuple[int, ...]:
    """Places in v of a body's joints, its floating base and what actuators own left out."""
    return tuple(int(model.joints[joint].idx_v) for joint in body.arm_joints)  # type: ignore[attr-defined]


@functools.singledispatch
def tip_law(controller: TipController, scene: Scene, tip: SceneTip, key: str) -> Channel | Payload:
    """What a controller of a tip asks for, of each kind; ``key`` is its own in the tip's section."""
    del scene, tip, key
    raise refusal(controller)


@tip_law.register
def _(controller: Pid, scene: Scene, tip: SceneTip, key: str) -> Channel:
    sensors, columns = sensors_of(tip.body), arm_columns(scene.model, tip.body)
    if key == "orientation_pid":
        rows = tuple(axis + 3 for axis in scene.rotation_axes)
        memory = tip.config.orientation_amnesia
    else:
        rows, memory = scene.translation_axes, tip.config.amnesia
    return Channel(tip, key, controller, memory, sensors, rows, columns, scene.spread)


@tip_law.register
def _(controller: PayloadFeedForward, scene: Scene, tip: SceneTip, key: str) -> Payload:
    del key
    rows = (*scene.translation_axes, *(axis + 3 for axis in scene.rotation_axes))
    return Payload(tip, controller, rows, arm_columns(scene.model, tip.body), scene.spread)
