"""Controllers whose law is Basilisk's flight software.

Such a controller contains a Basilisk simulation. At each update it writes the state of the base to a
spacecraft state message, runs Basilisk's tasks up to the present time, and reads commanded torques and
forces, which act on the base until the next update. This package simulates bodies, arms, captures and
impacts; Basilisk runs modules of flight software, navigation and environment that read a spacecraft's state.
Forces are held for a period, so that the coupling is first-order in it.
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
    """A Basilisk simulation, and the messages that connect it to the scene.

    Attributes:
        simulation: ``SimulationBaseClass.SimBaseClass`` with its processes and tasks, not yet initialised.
        state: ``messaging.SCStatesMsg``, to which the modules subscribe. The base is the spacecraft, and the
            scene's world is the inertial frame N.
        torques: ``CmdTorqueBody`` messages: torques on the base, base axes [N m].
        forces: ``CmdForceInertial`` messages: forces at the base's origin, axes of N [N].
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
        """New Basilisk simulation, built for each simulation of the scene."""
        raise NotImplementedError

    def measured(self, robot: RobotContext) -> Mapping[str, ca.SX]:
        """Measurements of a Python controller, and the base's rotation matrix, stacked by columns (9 x 1)."""
        rotation = robot.plant.placement(robot.base_frame)[0]
        return {**super().measured(robot), "base_rotation": ca.vec(ca.densify(rotation))}

    def updater(self, forces: HeldForces) -> Update:
        """Update function that runs Basilisk up to the present time and returns its commands."""
        messaging = optional_module("Basilisk.architecture.messaging", "basilisk", f"the kind {self.kind}")
        macros = optional_module("Basilisk.utilities.macros", "basilisk", f"the kind {self.kind}")
        joined = self.modules()
        joined.simulation.InitializeSimulation()

        def update(t: float, measurements: Mapping[str, Array]) -> Array:
            """Write the base's state, run Basilisk to time t [s], and return the commanded wrench."""
            payload = messaging.SCStatesMsgPayload()
            rotation = measurements["base_rotation"].reshape(3, 3, order="F")
            quaternion = pin.Quaternion(rotation)
            # modified Rodrigues parameters of the shorter rotation: e tan(angle / 4) = vec q / (1 + w)
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
