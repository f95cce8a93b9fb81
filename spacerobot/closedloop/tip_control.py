"""Tip control: PID on the velocity error and amnesia controller (Eq. 26-30, 35-38).

A tip is controlled in up to two channels, its translation and its rotation. They obey the same law and
differ in what they feed back, so both are built here.

    X_ta' = -t_a X_ta + (X_ref - X_tip)              Eq. 37, 38 (leaky integral)
    e_v   = x_ref' + G_e X_ta - v_feedback
    u     = K_p e_v + K_i int(e_v) + K_d d(e_v)/dt   Eq. 35
    tau   = J^T u                                    J: manipulator Jacobian, arm joints only

The ideal derivative makes u depend on the acceleration, which depends on u. It is left open here as
``u = command - gain (C a + drift)`` and closed exactly in :mod:`spacerobot.closedloop.forward_dynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.references import Motion
from spacerobot.closedloop.states import State
from spacerobot.dynamics import Wrench, configuration_derivative
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.rotations import rotation_log
from spacerobot.scenario import Pid, Robot
from spacerobot.scene import Scene, SceneBody, SceneTip


@dataclass(frozen=True)
class Channel:
    """One controlled part (translation or rotation) of a tip.

    Attributes
    ----------
    tip, name
        What it controls; the name is unique in the scene.
    actuation
        Transposed rows of the manipulator Jacobian: u to generalized forces (nv x n).
    drive
        ``actuation``, reduced (nv x n).
    sense
        Loads along which v' is the rate of the fed-back velocity, drift left out, reduced (nv x n).
    command
        u without the part that depends on v' (n x 1).
    derivative_gain
        K_d of the ideal derivative; none for a filtered one (n x 1 or None).
    states
        Integrals, amnesia and filter states.
    """

    tip: SceneTip
    name: str
    actuation: ca.SX
    drive: ca.SX
    sense: ca.SX
    command: ca.SX
    derivative_gain: ca.SX | None
    states: tuple[State, ...] = field(default=())

    @property
    def size(self) -> int:
        """Number of axes."""
        return self.command.size1()


@dataclass(frozen=True)
class _Signals:
    """What a channel's law works with, each reduced to the controlled axes."""

    jacobian: ca.SX  # manipulator Jacobian, n x nv
    drive: ca.SX  # reduced, nv x n
    sense: ca.SX  # reduced, nv x n
    velocity: ca.SX
    drift: ca.SX
    error: ca.SX | None  # of position or orientation, none where no amnesia controller reads it
    reference_velocity: ca.SX
    reference_acceleration: ca.SX


def build_channels(
    plant: Plant, tip: SceneTip, motion: Motion, parameters: Parameters, constants: Constants
) -> list[Channel]:
    """Controlled channels of a tip: none, its translation, its rotation or both."""
    channels = []
    scene, config = plant.scene, tip.config
    if config.pid is not None:
        axes = list(scene.translation_axes)
        signals = _signals(plant, tip, motion, config.pid, parameters, constants, axes, rotation=False)
        channels.append(_build_channel(tip, "pid", config.pid, signals, parameters, constants))
    if config.orientation_pid is not None:
        axes = list(scene.rotation_axes)
        pid = config.orientation_pid
        signals = _signals(plant, tip, motion, pid, parameters, constants, axes, rotation=True)
        channels.append(_build_channel(tip, "orientation_pid", pid, signals, parameters, constants))
    return channels


def _build_channel(
    tip: SceneTip,
    name: str,
    pid: Pid,
    signals: _Signals,
    parameters: Parameters,
    constants: Constants,
) -> Channel:
    label, path = f"{tip.label}/{name}", f"{tip.path}.{name}"
    kp, ki, kd = (
        constants.hoist(f"{path}.{gain}", parameters(f"{path}.{gain}")) for gain in ("kp", "ki", "kd")
    )
    size = signals.velocity.size1()
    wanted, wanted_rate = signals.reference_velocity, signals.reference_acceleration
    states = []
    if signals.error is not None:
        state, correction, correction_rate = _amnesia(tip, name, signals.error, parameters, constants)
        states.append(state)
        wanted, wanted_rate = wanted + correction, wanted_rate + correction_rate
    error = wanted - signals.velocity
    integral = ca.SX.sym(f"{label}.integral", size)
    states.append(State(f"{label}.integral", integral, ca.SX.zeros(size), error))
    command = kp * error + ki * integral  # Eq. 35
    if pid.derivative == "ideal":
        command = command + kd * (wanted_rate - signals.drift)
        gain: ca.SX | None = ca.repmat(kd, size, 1)
    else:
        lag = constants.hoist(f"{path}.filter_time", parameters(f"{path}.filter_time"))
        filtered = ca.SX.sym(f"{label}.filter", size)
        # begins at the error itself, so that the derivative does not kick; see build.py
        states.append(State(f"{label}.filter", filtered, error, (error - filtered) / lag))
        command, gain = command + kd * (error - filtered) / lag, None
    actuation = signals.jacobian.T
    return Channel(tip, label, actuation, signals.drive, signals.sense, command, gain, tuple(states))


def _amnesia(
    tip: SceneTip, name: str, error: ca.SX, parameters: Parameters, constants: Constants
) -> tuple[State, ca.SX, ca.SX]:
    """State X_ta, correction G_e X_ta and its rate (Eq. 37, 38)."""
    key = "amnesia" if name == "pid" else "orientation_amnesia"
    ge, ta = (
        constants.hoist(f"{tip.path}.{key}.{k}", parameters(f"{tip.path}.{key}.{k}")) for k in ("ge", "ta")
    )
    size = error.size1()
    memory = ca.SX.sym(f"{tip.label}/{key}", size)
    rate = error - ta * memory
    return State(f"{tip.label}/{key}", memory, ca.SX.zeros(size), rate), ge * memory, ge * rate


def _signals(
    plant: Plant,
    tip: SceneTip,
    motion: Motion,
    pid: Pid,
    parameters: Parameters,
    constants: Constants,
    axes: list[int],
    *,
    rotation: bool,
) -> _Signals:
    """Fed-back signals of a channel, sensors included (S = a + b s)."""
    rows = [axis + 3 for axis in axes] if rotation else axes
    arm = _arm_part(plant, tip, plant.jacobian(tip.frame)[rows, :])
    drive, felt = _reduced_loads(plant, tip, axes, rotation=rotation)
    calibrate = Calibrations(tip.body, parameters, constants)
    if pid.feedback == "base":
        rates = plant.arm_columns(tip.body)
        offset, scale = calibrate("joint_rate")
        velocity = ca.mtimes(arm, plant.v)
        drift = _relative_drift(plant, tip, rotation=rotation)[axes]
        sense = scale * drive
        velocity, drift = scale * velocity, scale * drift
        if offset is not None:
            ones = ca.SX(plant.v.size1(), 1)
            ones[rates] = 1
            seen = ca.mtimes(arm, ones)
            turning = ca.jtimes(seen, plant.q, configuration_derivative(plant.model, plant.q, plant.v))
            velocity, drift = velocity + offset * seen, drift + offset * turning
    else:
        offset, scale = calibrate("tip_angular_velocity" if rotation else "tip_velocity")
        velocity = scale * plant.velocity(tip.frame)[rotation][axes]
        drift, sense = scale * plant.drift(tip.frame)[rotation][axes], scale * felt
        if offset is not None:
            velocity = velocity + offset
    wanted = (
        (motion.angular_velocity, motion.angular_acceleration)
        if rotation
        else (motion.velocity, motion.acceleration)
    )
    amnesia = tip.config.orientation_amnesia if rotation else tip.config.amnesia
    error = None
    if amnesia is not None:
        error = _measured_error(plant, tip, motion, calibrate, axes, rotation=rotation)
    return _Signals(arm, drive, sense, velocity, drift, error, wanted[0][axes], wanted[1][axes])


def _measured_error(
    plant: Plant, tip: SceneTip, motion: Motion, calibrate: Calibrations, axes: list[int], *, rotation: bool
) -> ca.SX:
    """Reference minus measured position, or the rotation vector from measured orientation to reference."""
    turned, position = plant.placement(tip.frame)
    if not rotation:
        offset, scale = calibrate("tip_position")
        measured = scale * position[axes]
        if offset is not None:
            measured = measured + offset
        return motion.position[axes] - measured
    offset, scale = calibrate("tip_orientation")
    # the signal is the tip's rotation relative to its reference, so the error is its negative
    error = scale * orientation_error(plant.scene, motion.rotation, turned)[axes]
    return error if offset is None else error - offset


def orientation_error(scene: Scene, wanted: ca.SX, found: ca.SX) -> ca.SX:
    """Rotation vector (3x1), world axes, that turns ``found`` into ``wanted`` [rad]."""
    relative = ca.mtimes(wanted, found.T)
    if scene.planar:
        angle = ca.SX(3, 1)
        angle[2] = ca.atan2(relative[1, 0], relative[0, 0])
        return angle
    return rotation_log(relative)


def _arm_part(plant: Plant, tip: SceneTip, jacobian: ca.SX) -> ca.SX:
    """Manipulator Jacobian: the columns of the arm's free joints alone, the base's left out (Eq. 13)."""
    columns = plant.arm_columns(tip.body)
    part = ca.SX(*jacobian.shape)
    part[:, columns] = jacobian[:, columns]
    return plant.gathered(part.T).T


def _reduced_loads(plant: Plant, tip: SceneTip, axes: list[int], *, rotation: bool) -> tuple[ca.SX, ca.SX]:
    """Unit loads on a tip, reduced, as the arm's joints bring them about and as wrenches (nv x n each).

    An arm that presses at its tip presses back on its own base: ``J^T u`` with the manipulator Jacobian is
    the wrench u on the tip and -u, at the same point, on the base.
    """
    point, by_arm, by_wrench = plant.placement(tip.frame)[1], [], []
    for axis in axes:
        force, torque = unit_load(axis, rotation=rotation)
        on_tip = Wrench(tip.joint, force, torque, point)
        by_arm.append(plant.reduced(wrenches=[on_tip, Wrench(tip.body.root_joint, -force, -torque, point)]))
        by_wrench.append(plant.reduced(wrenches=[on_tip]))
    return ca.horzcat(*by_arm), ca.horzcat(*by_wrench)


def unit_load(axis: int, *, rotation: bool) -> tuple[ca.SX, ca.SX]:
    """Unit force along a world axis and no couple, or no force and a unit couple about it (3x1 each)."""
    unit, none = ca.SX(3, 1), ca.SX(3, 1)
    unit[axis] = 1
    return (none, unit) if rotation else (unit, none)


def _relative_drift(plant: Plant, tip: SceneTip, *, rotation: bool) -> ca.SX:
    """Rate, at zero joint acceleration, of the tip's velocity as seen from the base, in inertial axes."""
    tip_drift = plant.drift(tip.frame)
    if not tip.body.root_joint:
        return tip_drift[rotation]
    base_drift = plant.drift(tip.body.root_frame)
    if rotation:
        return tip_drift[1] - base_drift[1]
    lever = plant.placement(tip.frame)[1] - plant.placement(tip.body.root_frame)[1]
    tip_velocity = plant.velocity(tip.frame)[0]
    base_velocity, base_spin = plant.velocity(tip.body.root_frame)
    # d/dt of v_tip - v_base - omega_base x lever
    return (
        tip_drift[0]
        - base_drift[0]
        - cross(base_drift[1], lever)
        - cross(base_spin, tip_velocity - base_velocity)
    )


class Calibrations:
    """Sensor offsets a and scales b of a robot; ideal ones cost nothing."""

    def __init__(self, robot: SceneBody, parameters: Parameters, constants: Constants) -> None:
        self._robot = robot
        self._parameters = parameters
        self._constants = constants

    def __call__(self, signal: str) -> tuple[ca.SX | None, ca.SX]:
        """Offset a (None if the robot has no sensors section) and scale b (1x1) of a signal."""
        if not isinstance(self._robot.config, Robot) or self._robot.config.sensors is None:
            return None, ca.SX(1)
        path = f"{self._robot.path}.sensors.{signal}"
        return (
            self._constants.hoist(f"{path}.offset", self._parameters(f"{path}.offset")),
            self._constants.hoist(f"{path}.scale", self._parameters(f"{path}.scale")),
        )
