"""Basilisk module that simulates a scene: commands and environment in, spacecraft states out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from Basilisk.architecture import messaging, sysModel

from spacerobot.basilisk.external_forces import ExternalForces
from spacerobot.basilisk.held_inputs import KEY
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.elements import Actuator
from spacerobot.result import Result
from spacerobot.result.assembly import build_result
from spacerobot.rollout import build_rollout
from spacerobot.rollout.resumable_loop import resumed
from spacerobot.scene import Scene, SceneBody, build_scene, to_scene
from spacerobot.updates.plant import SHORT, SinglePlant


class SceneModule(sysModel.SysModel):
    """A scene simulated by Basilisk's clock; see :func:`spacerobot.basilisk.make_basilisk_scene`.

    At each step, the module reads its input messages, holds the commands, rolls out the scene with its
    controllers, captures and impacts to the present time, and writes its output messages.

    Attributes:
        scene: Scene with the elements that hold Basilisk's commands and forces.
        scStateOutMsgs: ``SCStatesMsg`` of each floating body by name: B is the root link's frame, C the
            centre of mass of the body with all its links.
        scStateOutMsg: ``SCStatesMsg`` of the robot.
        attRefOutMsg, transRefOutMsg: Attitude and position of the robot's base, which prescribe the motion of
            the spacecraft with the effectors.
        vehicleConfigOutMsg: ``VehicleConfigMsg`` with the mass properties of the robot in its initial
            posture.
        rwParamsOutMsg, rwSpeedOutMsg: ``RWArrayConfigMsg`` and ``RWSpeedMsg`` of the robot's wheels.
        jointStateOutMsgs: ``ScalarJointStateMsg`` with the position of each driven joint, by name.
        cmdTorqueInMsg, cmdForceInMsg: Readers of ``CmdTorqueBodyMsg`` and ``CmdForceBodyMsg``, the commands
            to the base's actuators.
        rwMotorTorqueInMsg: Reader of ``ArrayMotorTorqueMsg``, the torques of the wheels' motors.
        jointTorqueInMsgs: Readers of ``SingleActuatorMsg`` by joint name; the torques are added to those of
            the scenario's controllers.
    """

    def __init__(
        self,
        scenario: Scene | StrPath,
        robot: str | None,
        spacecraft: Any,
        *,
        period: float,
        extrapolated: bool,
        backend: Literal["auto", "compiled", "interpreted"],
    ) -> None:
        super().__init__()
        self.ModelTag = "spacerobot"
        original = to_scene(scenario)
        name = chosen_robot(original, robot)
        self.scene = with_inputs(original, name, forces=spacecraft is not None)
        self._body = next(one for one in self.scene.robots if one.name == name)
        self._loop = cached_closed_loop(self.scene)
        simulation = self.scene.scenario.simulation
        sample_s = min(period, simulation.output_step or period)
        rollout = build_rollout(
            resumed(self._loop),
            duration_s=period,
            step_s=simulation.step,
            output_step_s=sample_s,
            tolerance=simulation.tolerance,
            method=simulation.method,
            backend=backend,
            rollouts=simulation.duration / period,
        )
        self._plant = SinglePlant(self._loop, rollout, sample_s)
        self._extrapolated, self._data = extrapolated, self.scene.model.createData()
        self._forces = None
        if spacecraft is not None:
            self._forces = ExternalForces(spacecraft, self.scene.model, self._body.root_joint)
        self._last: tuple[float, Array] | None = None  # duration and wrenches of the previous step
        self._place_inputs()
        self._make_messages(spacecraft)

    def _place_inputs(self) -> None:
        """Find the indices of the held inputs in ``start``: time, state, switches."""
        states = {state: 1 + i for i, state in enumerate(self._loop.state_names)}
        model, body = self.scene.model, self._body
        self._joints = [body.joint_name(model, joint) for joint in body.driven_joints]
        count = len(self._joints) + 6
        self._commanded = [states[f"{body.name}/{KEY}.held[{i}]"] for i in range(count)]
        loads = [] if self._forces is None else [str(model.names[joint]) for joint in self._forces.loads]
        self._held = [[states[f"environment.{KEY}.{load}.held[{i}]"] for i in range(6)] for load in loads]

    def _make_messages(self, spacecraft: Any) -> None:
        """Create the messages and write their initial values."""
        bodies = [body.name for body in self.scene.bodies if body.root_joint]
        self.scStateOutMsgs = {name: messaging.SCStatesMsg() for name in bodies}
        self.scStateOutMsg = self.scStateOutMsgs[self._body.name]
        self.attRefOutMsg, self.transRefOutMsg = messaging.AttRefMsg(), messaging.TransRefMsg()
        self.vehicleConfigOutMsg = messaging.VehicleConfigMsg()
        self.rwParamsOutMsg, self.rwSpeedOutMsg = messaging.RWArrayConfigMsg(), messaging.RWSpeedMsg()
        self.jointStateOutMsgs = {name: messaging.ScalarJointStateMsg() for name in self._joints}
        self.cmdTorqueInMsg = messaging.CmdTorqueBodyMsgReader()
        self.cmdForceInMsg = messaging.CmdForceBodyMsgReader()
        self.rwMotorTorqueInMsg = messaging.ArrayMotorTorqueMsgReader()
        self.jointTorqueInMsgs = {name: messaging.SingleActuatorMsgReader() for name in self._joints}
        stores = [one.momentum_storage() for one in _actuators(self._body)]
        self._wheels = next((one for one in stores if one is not None), None)
        self._write_properties()
        self._write(0)
        if spacecraft is not None:
            properties, hub = self.vehicleConfigOutMsg.read(), spacecraft.hub
            hub.mHub, hub.r_BcB_B = properties.massSC, properties.CoM_B
            about_base, lever = np.reshape(properties.ISCPntB_B, (3, 3)), pin.skew(np.array(properties.CoM_B))
            hub.IHubPntBc_B = (about_base + properties.massSC * lever @ lever).tolist()
            spacecraft.attRefInMsg.subscribeTo(self.attRefOutMsg)
            spacecraft.transRefInMsg.subscribeTo(self.transRefOutMsg)

    def _write_properties(self) -> None:
        """Write the mass properties of the robot and its wheels."""
        model, base = self.scene.model, self._body.root_joint
        data = model.createData()
        pin.crba(model, data, self.scene.q)
        inertia = data.Ycrb[base]
        lever = pin.skew(inertia.lever)
        about_base = inertia.inertia - inertia.mass * lever @ lever
        config = messaging.VehicleConfigMsgPayload()
        config.massSC, config.CoM_B = inertia.mass, inertia.lever.tolist()
        config.ISCPntB_B = about_base.ravel().tolist()
        self.vehicleConfigOutMsg.write(config)
        if self._wheels is not None:
            wheels, count = messaging.RWArrayConfigMsgPayload(), self._wheels.axes.shape[1]
            wheels.numRW, wheels.GsMatrix_B = count, self._wheels.axes.T.ravel().tolist()
            wheels.JsList = [float(self._wheels.inertia)] * count
            limit = self._wheels.torque_limit
            wheels.uMax = [1e300 if limit is None else float(limit)] * count
            self.rwParamsOutMsg.write(wheels)

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Simulate the scene up to the present time.

        Args:
            CurrentSimNanos: Time [ns].

        Raises:
            SpaceRobotError: If the simulation diverged.
        """
        t, now = CurrentSimNanos * 1e-9, float(self._plant.start[0, 0])
        if self.ended:
            return
        if t > now:
            self._read(now, t - now)
            self._plant.advance(np.array([0]), t)
            piece = self._plant.pieces[-1][1]
            if piece.status != "completed":
                raise SpaceRobotError(f"the simulation diverged after t = {now:g} s: {piece.cause}")
            if self._forces is not None:
                self._forces.fall(t - now)
        self._write(CurrentSimNanos)

    @property
    def ended(self) -> bool:
        """Whether the scenario's last phase has ended; messages then keep their values."""
        return bool(self._plant.ended[0])

    def _read(self, now: float, duration: float) -> None:
        """Read the input messages and hold the commands and the forces of the environment."""
        start, count = self._plant.start[0], len(self._joints)
        command = np.zeros(count + 6)
        for i, name in enumerate(self._joints):
            if self.jointTorqueInMsgs[name].isLinked():
                command[i] = self.jointTorqueInMsgs[name]().input
        if self.cmdForceInMsg.isLinked():
            command[count : count + 3] = self.cmdForceInMsg().forceRequestBody
        if self.cmdTorqueInMsg.isLinked():
            command[count + 3 :] = self.cmdTorqueInMsg().torqueRequestBody
        if self.rwMotorTorqueInMsg.isLinked() and self._wheels is not None:
            axes = self._wheels.axes
            torques = np.array(self.rwMotorTorqueInMsg().motorTorque[: axes.shape[1]])
            command[count + 3 :] -= axes @ torques
        start[self._commanded] = command
        if self._forces is not None:
            wrenches = self._forces.wrenches(start[1 : 1 + self.scene.model.nq], now, duration)
            held = wrenches
            if self._extrapolated and self._last is not None:
                # mean over the next step of the line through the last two instants: second-order accurate
                held = wrenches + duration / (2 * self._last[0]) * (wrenches - self._last[1])
            self._last = duration, wrenches
            for places, row in zip(self._held, held, strict=True):
                start[places] = row

    def _write(self, nanos: int) -> None:
        """Write the output messages for the present state."""
        model, data, start = self.scene.model, self._data, self._plant.start[0]
        q, v = start[1 : 1 + model.nq], start[1 + model.nq : 1 + model.nq + model.nv]
        pin.forwardKinematics(model, data, q, v)
        pin.centerOfMass(model, data, q, v, True)
        origin = np.zeros(6) if self._forces is None else self._forces.origin
        for body in self.scene.bodies:
            if body.name in self.scStateOutMsgs:
                payload = _state(data, body.root_joint, origin)
                self.scStateOutMsgs[body.name].write(payload, nanos, self.moduleID)
        base = _state(data, self._body.root_joint, origin)
        rotation = data.oMi[self._body.root_joint].rotation
        attitude, place = messaging.AttRefMsgPayload(), messaging.TransRefMsgPayload()
        attitude.sigma_RN = base.sigma_BN
        attitude.omega_RN_N = (rotation @ np.array(base.omega_BN_B)).tolist()
        place.r_RN_N, place.v_RN_N = base.r_BN_N, base.v_BN_N
        self.attRefOutMsg.write(attitude, nanos, self.moduleID)
        self.transRefOutMsg.write(place, nanos, self.moduleID)
        for name, joint in zip(self._joints, self._body.driven_joints, strict=True):
            one = model.joints[joint]
            angle = q[one.idx_q] if one.nq == 1 else np.arctan2(q[one.idx_q + 1], q[one.idx_q])
            payload = messaging.ScalarJointStateMsgPayload()
            payload.state = float(angle)
            self.jointStateOutMsgs[name].write(payload, nanos, self.moduleID)
        if self._wheels is not None:
            speeds = messaging.RWSpeedMsgPayload()
            speeds.wheelSpeeds = self.output("wheel_speed").tolist()
            self.rwSpeedOutMsg.write(speeds, nanos, self.moduleID)

    def output(self, name: str) -> Array:
        """Output of the scene at the present time (n,).

        Args:
            name: Name of a variable of results, such as ``tip_error``, ``grasp_gap`` or ``wheel_speed``.

        Raises:
            SpaceRobotError: If there is no such output.
        """
        plant = self._plant
        outputs: Mapping[str, Array] = plant.pieces[-1][1].outputs if plant.pieces else self._first()
        if name not in outputs:
            raise SpaceRobotError(f"output: found {name!r}, {near_names(name, outputs)}")
        return np.ravel(outputs[name][-1])

    def _first(self) -> Mapping[str, Array]:
        """Outputs at the start."""
        scout = self._plant.scout()
        scout.advance(np.array([0]), SHORT)
        return scout.pieces[-1][1].outputs

    def result(self) -> Result:
        """Result of the simulation up to the present time.

        Raises:
            SpaceRobotError: If the simulation has not begun.
        """
        plant = self._plant
        if not plant.pieces:
            raise SpaceRobotError("the simulation has not begun: call ExecuteSimulation()")
        return build_result(self.scene, self._loop, plant.trajectory)


def chosen_robot(scene: Scene, name: str | None) -> str:
    """Name of the robot whose base is the spacecraft; the first on a floating base if None.

    Raises:
        ScenarioError: If no robot on a floating base has this name.
    """
    floating = [body.name for body in scene.robots if body.root_joint]
    if not floating:
        raise scene.error("robots: found no floating base, allowed: one for Basilisk's spacecraft", "robots")
    if name is not None and name not in floating:
        raise scene.error(f"robot: found {name!r}, {near_names(name, floating)}", "robots")
    return floating[0] if name is None else name


def with_inputs(scene: Scene, robot: str, *, forces: bool) -> Scene:
    """Scene with elements that hold Basilisk's commands, and Basilisk's forces on all bodies.

    Args:
        scene, robot: The scene, and the name of the commanded robot.
        forces: Whether Basilisk's gravity and effectors act.

    Raises:
        ScenarioError: If Basilisk's forces act in addition to a gravity of the scenario.
    """
    body = next(one for one in scene.robots if one.name == robot)
    parts = {part for actuator in _actuators(body) for part in actuator.own_wrench}
    ordered = [part for part in ("force", "torque") if part in parts]
    changes: dict[str, Any] = {
        f"{body.path}.controllers.{KEY}": {"kind": "basilisk_commands", "parts": ordered}
    }
    if forces:
        changes[f"environment.{KEY}"] = {"kind": "basilisk_forces"}
    return build_scene(scene.scenario, changes, source=scene.source)


def _actuators(body: SceneBody) -> list[Actuator]:
    return [one for one in body.config.actuators.values() if isinstance(one, Actuator)]  # type: ignore[union-attr]


def _state(data: pin.Data, joint: int, origin: Array) -> Any:
    """State message of a body.

    Args:
        data: Pinocchio data with kinematics and the centres of mass of all subtrees.
        joint: Joint of the body's root link.
        origin: Position and velocity of the scene's origin in N (6,) [m, m/s].
    """
    placement, motion = data.oMi[joint], data.v[joint]
    rotation = placement.rotation
    quaternion = pin.Quaternion(rotation)
    # modified Rodrigues parameters of the shorter rotation: e tan(angle / 4) = vec q / (1 + w)
    if quaternion.w < 0:
        quaternion = pin.Quaternion(-quaternion.coeffs())
    payload = messaging.SCStatesMsgPayload()
    payload.sigma_BN = (quaternion.vec() / (1 + quaternion.w)).tolist()
    payload.omega_BN_B = motion.angular.tolist()
    payload.r_BN_N = (origin[:3] + placement.translation).tolist()
    payload.v_BN_N = (origin[3:] + rotation @ motion.linear).tolist()
    payload.r_CN_N = (origin[:3] + placement.act(data.com[joint])).tolist()
    payload.v_CN_N = (origin[3:] + rotation @ data.vcom[joint]).tolist()
    return payload
