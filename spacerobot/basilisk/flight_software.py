"""Basilisk's flight software on a floating base: our scene in Basilisk's world of messages.

A controller of this kind holds a Basilisk simulation. At each of its updates it writes the state of the base
as a spacecraft state message, lets Basilisk's tasks run to the present time, and reads commanded torques and
forces, which act on the base until the next update. Arms, captures and impacts are simulated here; modules
of flight software, navigation and environment that read a spacecraft's state run there. Because forces are
held for a period, the coupling is of first order in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.optional import optional_module
from spacerobot.common.registry import required
from spacerobot.elements.controllers.python_controller import HeldForces, PythonController, Update
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.robot_element import Part


@dataclass(frozen=True)
class BasiliskModules:
    """A Basilisk simulation, and the messages that join it to the scene.

    Attributes:
        simulation: ``SimulationBaseClass.SimBaseClass`` with its processes and tasks; it is initialised here.
        state: ``messaging.SCStatesMsg``, to which its modules subscribe: the base is the spacecraft, the
            scene's world the inertial frame N.
        torques: Messages of ``CmdTorqueBody``: on the base, in its axes [N m].
        forces: Messages of ``CmdForceInertial``: at the base's origin, in axes of N [N].
    """

    simulation: Any
    state: Any
    torques: tuple[Any, ...] = ()
    forces: tuple[Any, ...] = ()


class BasiliskController(PythonController):
    """Controller whose law is a Basilisk simulation; a subclass implements :meth:`modules`."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    @required()
    def modules(self) -> BasiliskModules:
        """Return a new Basilisk simulation; called once for each simulation of the scene."""
        raise NotImplementedError

    def measured(self, robot: RobotContext) -> Mapping[str, ca.SX]:
        """Measurements of a Python controller, and the rotation matrix of the base, by columns (9 x 1)."""
        rotation = robot.plant.placement(robot.base_frame)[0]
        return {**super().measured(robot), "base_rotation": ca.vec(ca.densify(rotation))}

    def updater(self, forces: HeldForces) -> Update:
        """Return a function that lets Basilisk run to the present and reads its commands."""
        messaging = optional_module("Basilisk.architecture.messaging", "basilisk", f"the kind {self.kind}")
        macros = optional_module("Basilisk.utilities.macros", "basilisk", f"the kind {self.kind}")
        joined = self.modules()
        joined.simulation.InitializeSimulation()

        def update(t: float, measurements: Mapping[str, Array]) -> Array:
            """Write the base's state, run Basilisk to time t [s], and return the commanded wrench."""
            payload = messaging.SCStatesMsgPayload()
            rotation = measurements["base_rotation"].reshape(3, 3, order="F")
            quaternion = pin.Quaternion(rotation)
            # modified Rodrigues parameters of the short rotation: e tan(angle / 4)
            if quaternion.w < 0:
                quaternion = pin.Quaternion(-quaternion.coeffs())
            payload.sigma_BN = (quaternion.vec() / (1 + quaternion.w)).tolist()
            payload.r_BN_N = measurements["base_position"].tolist()
            payload.v_BN_N = measurements["base_velocity"].tolist()
            payload.omega_BN_B = (rotation.T @ measurements["base_spin"]).tolist()
            time = macros.sec2nano(t)
            joined.state.write(payload, time)
            joined.simulation.ConfigureStopTime(time)
            joined.simulation.ExecuteSimulation()
            force, torque = np.zeros(3), np.zeros(3)
            for message in joined.torques:
                torque += rotation @ np.array(message.read().torqueRequestBody)
            for message in joined.forces:
                force += np.array(message.read().forceRequestInertial)
            return np.concatenate([np.zeros(len(forces.joints)), force, torque])

        return update
