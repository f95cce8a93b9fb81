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

from spacerobot.common.arrays import Array
from spacerobot.elements import TipController
from spacerobot.elements.controllers.admittance import Admittance
from spacerobot.elements.controllers.hybrid_force import HybridForce
from spacerobot.elements.controllers.impedance import Impedance
from spacerobot.elements.controllers.payload_feed_forward import PayloadFeedForward
from spacerobot.elements.controllers.pid import Pid
from spacerobot.pinocchio_engine.mechanical_state import FrameMotion
from spacerobot.scenario.bodies import Amnesia
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene, SceneBody, SceneTip
from tests.oracles.engine.kinematics import Kinematics, rotation_vector
from tests.oracles.engine.laws import refusal
from tests.oracles.engine.references import Motion
from tests.oracles.engine.sensing import reading_of, sensors_of


@dataclass(frozen=True)
class Command:
    """What a channel asks for at one instant: ``u = command - gain (feedback v')``, torques ``J^T u``.

    Attributes:
        jacobian, feedback: (n, nv) each.
        command: (n,).
        gain: K_d of an ideal derivative, zero of a filtered one.
        velocity_error: e_v (n,).
        rates: Rates of the channel's states, in their order.
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

    Attributes:
        rows: Its rows of a Jacobian: 0 to 2 of a translation, 3 to 5 of a rotation.
        columns: Places of the arm's joints in v.
        spread: Velocities of all joints from those of the free ones (nv, nv).
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


@dataclass(frozen=True)
class TipImpedance:
    """Spring and damper at a tip, by the momentum of the robot and Pinocchio's logarithm."""

    tip: SceneTip
    config: Impedance
    sensors: Sensors
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    spread: Array
    state_names: tuple[str, ...] = ()

    def initial(self, kinematics: Kinematics, motion: Motion) -> Array:
        """No states."""
        del kinematics, motion
        return np.zeros(0)

    def evaluate(self, kinematics: Kinematics, motion: Motion, states: Array) -> Command:
        """Force or couple, by the joints' motion that conserves the robot's momentum."""
        del states
        frame, rows, turns = kinematics.frame(self.tip.frame), list(self.rows), self.rows[0] >= 3
        axes = motion.rotation if self.config.axes == "reference" else np.eye(3)
        stiffness, damping = (
            axes @ np.diag(gains) @ axes.T for gains in (self.config.stiffness, self.config.damping)
        )
        names = ("tip_orientation", "tip_angular_velocity") if turns else ("tip_position", "tip_velocity")
        pose, rate = (reading_of(self.sensors[name]) for name in names)
        seen = rate.offset + rate.scale * frame.velocity[3 * turns : 3 * turns + 3]
        if turns:
            phi = -(pose.offset + pose.scale * rotation_vector(frame.rotation, motion.rotation))
            # Jlog3 is the inverse of the right Jacobian, whose transpose is the inverse of the left one
            spring = pin.Jlog3(pin.exp3(phi)).T @ stiffness @ phi
            wrench = spring + damping @ (motion.angular_velocity - seen)
        else:
            spring = stiffness @ (motion.position - (pose.offset + pose.scale * frame.position))
            wrench = spring + damping @ (motion.velocity - seen)
        feedback = frame.jacobian[rows]
        command = wrench[[row % 3 for row in rows]]
        carried = reacting(kinematics, self.tip, self.columns, self.spread)
        return Command(feedback @ carried, feedback, command, 0.0, np.zeros(0), np.zeros(0))


def reacting(kinematics: Kinematics, tip: SceneTip, columns: tuple[int, ...], spread: Array) -> Array:
    """Velocities of all joints and of the base, whose momentum the arm's joints conserve (nv, nv)."""
    carried = spread.copy()
    carried[:, [k for k in range(len(carried)) if k not in columns]] = 0
    if tip.body.root_joint:
        root = kinematics.model.joints[tip.body.root_joint]
        base = slice(root.idx_v, root.idx_v + root.nv)
        momentum = kinematics.inertia[base]
        carried[base] = -np.linalg.solve(momentum[:, base], momentum @ carried)
    return carried


@dataclass(frozen=True)
class TipAcceleration:
    """Torques that accelerate a tip as a law of force asks for, solved in the coordinates of the whole scene.

    Attributes:
        coupled: Tips of the robot, and rows of a Jacobian that their controllers control; its own first.
        resistance: Viscous resistance of each velocity component (nv,).
    """

    tip: SceneTip
    key: str
    config: Impedance | Admittance | HybridForce
    sensors: Sensors
    rows: tuple[int, ...]
    coupled: tuple[tuple[SceneTip, tuple[int, ...]], ...]
    columns: tuple[int, ...]
    spread: Array
    resistance: Array

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""
        blocks = {"admittance": ("offset", "rate"), "hybrid_force": ("integral",)}
        names = blocks.get(self.config.kind, ())
        return tuple(f"{self.tip.label}/{self.key}.{n}[{i}]" for n in names for i in range(len(self.rows)))

    def initial(self, kinematics: Kinematics, motion: Motion) -> Array:
        """Zero."""
        del kinematics, motion
        return np.zeros(len(self.state_names))

    def evaluate(self, kinematics: Kinematics, motion: Motion, states: Array) -> Command:
        """Torques whose acceleration, with the measured wrench in place of the true one, is the desired."""
        frame, model = kinematics.frame(self.tip.frame), kinematics.model
        felt, *others = (self._felt(kinematics, tip) for tip, _ in self.coupled)
        desired, rates = self._desired(frame, motion, felt, states)
        free = self.spread[:, np.diag(self.spread) > 0]
        inverse = free @ np.linalg.solve(free.T @ kinematics.inertia @ free, free.T)
        # the robot knows itself alone: what others do to the scene does not reach its joints
        pushed = frame.jacobian.T @ felt
        for (tip, _), wrench in zip(self.coupled[1:], others, strict=True):
            pushed = pushed + kinematics.frame(tip.frame).jacobian.T @ wrench
        load = pushed - pin.nonLinearEffects(model, model.createData(), kinematics.q, kinematics.v)
        falling = frame.jacobian @ inverse @ (load - self.resistance * kinematics.v) + frame.drift
        carried = reacting(kinematics, self.tip, self.columns, self.spread)
        controlled = np.vstack([kinematics.frame(tip.frame).jacobian[list(own)] for tip, own in self.coupled])
        actuation = (controlled @ carried).T
        effect, rows = controlled @ inverse @ actuation, list(self.rows)
        chosen = [self.coupled[0][1].index(row) for row in rows]
        shaped = actuation @ np.linalg.inv(effect)[:, chosen]
        axes = [row % 3 for row in rows]
        command = desired[axes] - falling[rows]
        return Command(shaped.T, frame.jacobian[rows], command, 0.0, np.zeros(0), rates)

    def _felt(self, kinematics: Kinematics, tip: SceneTip) -> Array:
        """Wrench on a tip as the robot's sensors give it (6,)."""
        parts = np.split(kinematics.felt.get(tip.label, np.zeros(6)), 2)
        readings = [reading_of(self.sensors[name]) for name in ("tip_force", "tip_torque")]
        return np.concatenate([r.offset + r.scale * part for r, part in zip(readings, parts, strict=True)])

    def _desired(self, frame: FrameMotion, motion: Motion, felt: Array, states: Array) -> tuple[Array, Array]:
        """Acceleration (3,) of the law, and the rates of its states."""
        config, turns = self.config, self.rows[0] >= 3
        axes = motion.rotation if config.axes == "reference" else np.eye(3)
        part, free = slice(3 * turns, 3 * turns + 3), [row % 3 for row in self.rows]
        names = ("tip_orientation", "tip_angular_velocity") if turns else ("tip_position", "tip_velocity")
        pose, rate = (reading_of(self.sensors[name]) for name in names)
        speed = rate.offset + rate.scale * frame.velocity[part]
        if turns:
            place = rotation_vector(frame.rotation, motion.rotation)
            error = -(pose.offset + pose.scale * place)
            error_rate, ahead = motion.angular_velocity - speed, motion.angular_acceleration
        else:
            error = motion.position - (pose.offset + pose.scale * frame.position)
            error_rate, ahead = motion.velocity - speed, motion.acceleration

        def along(values: tuple[float, ...]) -> Array:
            return axes @ np.diag(values) @ axes.T

        def spread_out(values: Array) -> Array:
            full = np.zeros(3)
            full[free] = values
            return full

        if isinstance(config, Impedance):
            spring = along(config.stiffness) @ error
            if turns:
                spring = pin.Jlog3(pin.exp3(error)).T @ spring
            load = spring + along(config.damping) @ error_rate + felt[part]
            assert config.inertia is not None
            return ahead + np.linalg.solve(along(config.inertia), load), np.zeros(0)
        if isinstance(config, Admittance):
            offset, moving = (spread_out(half) for half in np.split(states, 2))
            load = felt[part] - along(config.damping) @ moving - along(config.stiffness) @ offset
            acceleration = np.linalg.solve(along(config.inertia), load)
            rates = np.concatenate([moving[free], acceleration[free]])
            if turns:
                turned = pin.exp3(offset)
                spin = pin.Jexp3(-offset) @ moving + turned @ motion.angular_velocity
                error_rate = spin - speed
                error = pin.log3(turned @ pin.exp3(error))
            else:
                error, error_rate = error + offset, error_rate + moving
            w = config.bandwidth
            return ahead + acceleration + 2 * w * error_rate + w**2 * error, rates
        chosen = along(config.selection)
        missing = chosen @ (axes @ np.array(config.force) + felt[part])
        push = config.force_gain * missing + config.force_damping * chosen @ error_rate
        push = push + config.force_integral * chosen @ spread_out(states)
        stay = (np.eye(3) - chosen) @ (config.kd * error_rate + config.kp * error)
        return ahead + stay + push, missing[free]


def arm_columns(model: object, body: SceneBody) -> tuple[int, ...]:
    """Places in v of a body's joints, its floating base and what actuators own left out."""
    return tuple(int(model.joints[joint].idx_v) for joint in body.arm_joints)  # type: ignore[attr-defined]


@functools.singledispatch
def tip_law(
    controller: TipController, scene: Scene, tip: SceneTip, key: str
) -> Channel | Payload | TipImpedance | TipAcceleration:
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


@tip_law.register(Admittance)
@tip_law.register(HybridForce)
def _(
    controller: Admittance | HybridForce | Impedance, scene: Scene, tip: SceneTip, key: str
) -> TipAcceleration:
    translation, rotation = scene.translation_axes, tuple(axis + 3 for axis in scene.rotation_axes)
    coupled = []
    for each in sorted(scene.tips, key=lambda other: other.label != tip.label):
        controlled = {one.controls(name) for name, one in each.config.elements()}
        rows = translation * ("translation" in controlled) + rotation * ("rotation" in controlled)
        if each.body.name == tip.body.name:
            coupled.append((each, rows))
    resistance = np.zeros(scene.model.nv)
    for name, joint in tip.body.config.joints.items():
        place = scene.model.joints[scene.model.getJointId(f"{tip.body.name}/{name}")]
        resistance[place.idx_v] = joint.damping or 0.0
    return TipAcceleration(
        tip,
        key,
        controller,
        sensors_of(tip.body),
        rotation if controller.controls(key) == "rotation" else translation,
        tuple(coupled),
        arm_columns(scene.model, tip.body),
        scene.spread,
        resistance,
    )


@tip_law.register
def _(controller: Impedance, scene: Scene, tip: SceneTip, key: str) -> TipImpedance | TipAcceleration:
    if controller.inertia is not None:
        return tip_law.dispatch(Admittance)(controller, scene, tip, key)
    rows = scene.translation_axes
    if controller.controls(key) == "rotation":
        rows = tuple(axis + 3 for axis in scene.rotation_axes)
    columns = arm_columns(scene.model, tip.body)
    return TipImpedance(tip, controller, sensors_of(tip.body), rows, columns, scene.spread)
