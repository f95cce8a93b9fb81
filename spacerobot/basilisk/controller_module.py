"""Basilisk module with a scene's controllers, which control an ``MJScene``."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from Basilisk.architecture import messaging, sysModel

from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.exports.mjcf_bodies import coordinates, model_coordinates
from spacerobot.exports.mjcf_scene import scene_mjcf, scene_wheels
from spacerobot.rollout import build_rollout
from spacerobot.rollout.resumable_loop import resumed
from spacerobot.scene import Scene, to_scene
from spacerobot.updates.plant import SinglePlant


class ControllerModule(sysModel.SysModel):
    """Controllers of a scene for an ``MJScene``; see :func:`spacerobot.basilisk.make_basilisk_controller`.

    At each step, the module reads the state of the bodies, predicts the next period with the scene's own
    model, and commands the means of the predicted torques. Since the prediction begins in the measured state,
    held torques differ from continuous ones only at second order of the period. The prediction also advances
    the controllers' states (integrals, samples, phases).

    Attributes:
        scene: The scene.
        bodies: The ``MJScene``, to be added to a task before this module.
        torqueOutMsgs: ``SingleActuatorMsg`` with the torque of each motor by name: joints, then wheels.
    """

    def __init__(
        self,
        scenario: Scene | StrPath,
        bodies: Any,
        *,
        period: float,
        backend: Literal["auto", "compiled", "interpreted"],
    ) -> None:
        super().__init__()
        self.ModelTag = "spacerobot"
        self.scene = to_scene(scenario)
        self._check_actuators()
        if bodies is None:
            from Basilisk.simulation import mujoco

            bodies = mujoco.MJScene(scene_mjcf(self.scene, visuals=False))
        self.bodies, self._period = bodies, period
        self._loop = cached_closed_loop(self.scene)
        simulation = self.scene.scenario.simulation
        rollout = build_rollout(
            resumed(self._loop),
            duration_s=period,
            step_s=simulation.step,
            output_step_s=period / 2,
            tolerance=simulation.tolerance,
            method=simulation.method,
            backend=backend,
            rollouts=simulation.duration / period,
        )
        self._plant = SinglePlant(self._loop, rollout, period / 2)
        self._place_motors()

    def _check_actuators(self) -> None:
        """Check that MuJoCo's description has motors for all actuators.

        Raises:
            ScenarioError: If a base has other actuators than wheels.
        """
        for body in self.scene.robots:
            for name, actuator in body.config.actuators.items():  # type: ignore[union-attr]
                if actuator.own_wrench and actuator.momentum_storage() is None:
                    raise self.scene.error(
                        f"kind {actuator.kind} has no motor in MuJoCo's description; allowed: wheels",
                        f"{body.path}.actuators.{name}",
                    )

    def _place_motors(self) -> None:
        """Connect motors to messages, and find the states of the wheels."""
        model = self.scene.model
        self._wheels, self._speeds = scene_wheels(self.scene)
        states = {state: 1 + i for i, state in enumerate(self._loop.state_names)}
        joints = sorted(joint for body in self.scene.bodies for joint in body.arm_joints)
        driven = [joint for body in self.scene.bodies for joint in body.driven_joints]
        self._joint_places = [joints.index(joint) for joint in driven]
        names = [str(model.names[joint]) for joint in driven]
        self._momenta = dict[int, list[int]]()  # indices of the wheels' momenta, by the joint of their base
        for body in self.scene.robots:
            for key, actuator in body.config.actuators.items():  # type: ignore[union-attr]
                if body.root_joint in self._wheels and actuator.momentum_storage() is not None:
                    count = self._wheels[body.root_joint][0].shape[1]
                    places = [states[f"{body.name}/{key}.momentum[{i}]"] for i in range(count)]
                    self._momenta[body.root_joint] = places
                    prefix = "" if len(self._wheels) == 1 else f"{body.name}/"
                    names += [f"{prefix}wheel_{i}" for i in range(count)]
        self.torqueOutMsgs = {name: messaging.SingleActuatorMsg() for name in names}
        for name, message in self.torqueOutMsgs.items():
            message.write(messaging.SingleActuatorMsgPayload())
            self.bodies.getSingleActuator(name).actuatorInMsg.subscribeTo(message)

    def Reset(self, CurrentSimNanos: int) -> None:
        """Set the bodies to the initial state of the scene.

        Args:
            CurrentSimNanos: Time [ns], not used.
        """
        del CurrentSimNanos
        model, scene = self.scene.model, self.scene
        position, velocity = coordinates(scene, scene.q, scene.v)
        for index, joint in enumerate(model.joints[1:], start=1):
            body = self.bodies.getBody(str(model.names[index]))
            at = sum(7 if one.nv == 6 else one.nv for one in list(model.joints)[1:index])
            x, v = position[at:], velocity[joint.idx_v :]
            if joint.nv == 6:
                body.setPosition(x[:3].tolist())
                body.setVelocity(v[:3].tolist())
                body.setAttitude((x[4:7] / (1 + x[3])).tolist())
                body.setAttitudeRate(v[3:6].tolist())
            else:
                suffixes = (".x", ".y", ".r") if joint.nv == 3 else ("",)
                for k, suffix in enumerate(suffixes):
                    one = body.getScalarJoint(f"{model.names[index]}{suffix}")
                    one.setPosition(float(x[k]))
                    one.setVelocity(float(v[k]))
            prefix = "" if len(self._wheels) == 1 else f"{str(model.names[index]).partition('/')[0]}/"
            for i, speed in enumerate(self._speeds.get(index, ())):
                name = f"{prefix}wheel_{i}"
                self.bodies.getBody(name).getScalarJoint(name).setVelocity(float(speed))

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Command the motors for the next period.

        Args:
            CurrentSimNanos: Time [ns].
        """
        t, model, start = CurrentSimNanos * 1e-9, self.scene.model, self._plant.start[0]
        measured = self.bodies.stateOutMsg.read()
        counts = {joint: axes.shape[1] for joint, (axes, _) in self._wheels.items()}
        q, v, speeds = model_coordinates(self.scene, np.ravel(measured.qpos), np.ravel(measured.qvel), counts)
        start[0], start[1 : 1 + model.nq] = t, q
        start[1 + model.nq : 1 + model.nq + model.nv] = v
        for joint, (axes, inertia) in self._wheels.items():
            first = model.idx_vs[joint]
            # axial momentum J (relative speed + a . w): the base's rotation turns the wheels too
            start[self._momenta[joint]] = inertia * (speeds[joint] + axes.T @ v[first + 3 : first + 6])
        self._plant.advance(np.array([0]), t + self._period)
        for message, torque in zip(self.torqueOutMsgs.values(), self._torques(), strict=True):
            message.write(messaging.SingleActuatorMsgPayload(input=torque), CurrentSimNanos, self.moduleID)

    def _torques(self) -> Array:
        """Mean predicted torques of all motors (n,) [N m].

        Raises:
            SpaceRobotError: If the prediction diverges.
        """
        begin, piece = self._plant.pieces.pop()
        if piece.status != "completed":
            raise SpaceRobotError(
                f"the controllers diverged after t = {begin:g} s, their torques held for {self._period:g} s: "
                "take a shorter period"
            )
        names = ["joint_torque", *(["wheel_torque"] if self._momenta else [])]
        means = [
            np.trapezoid(piece.outputs[name].reshape(len(piece.time), -1), piece.time, axis=0)
            / (piece.time[-1] - piece.time[0])
            for name in names
        ]
        return np.concatenate([means[0][self._joint_places], *means[1:]])
