"""Gravity and dynamic effectors of a Basilisk spacecraft, evaluated at the poses of a scene's bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError


class ExternalForces:
    """Forces of a Basilisk spacecraft's gravity field and dynamic effectors on the bodies of a scene.

    The scene's origin falls freely in the gravity field from the spacecraft's initial position and velocity.
    A body's gravity is the difference between the acceleration at its centre of mass and that at the origin.
    Effectors act on the base.

    Attributes:
        loads: Joints of the bodies with mass.
        origin: Position and velocity of the scene's origin in the inertial frame N (6,) [m, m/s].

    Args:
        spacecraft: ``spacecraft.Spacecraft``, whose motion is prescribed by that of the base.
        model: Model of the scene.
        base: Joint of the base that carries the effectors.
    """

    def __init__(self, spacecraft: Any, model: pin.Model, base: int) -> None:
        self._spacecraft, self._base, self._model = spacecraft, base, model
        self._data = model.createData()
        self.loads = [j for j in range(1, model.njoints) if model.inertias[j].mass > 0]
        position, velocity = np.ravel(spacecraft.hub.r_CN_NInit), np.ravel(spacecraft.hub.v_CN_NInit)
        self.origin = np.concatenate([position, velocity])
        self._attracts = len(spacecraft.gravField.gravBodies) > 0

    def gravity(self, position: Array) -> Array:
        """Gravitational acceleration (3,) [m/s^2] at a position (3,) [m], frame N."""
        if not self._attracts:
            return np.zeros(3)
        field, manager = self._spacecraft.gravField, self._spacecraft.dynManager
        field.computeGravityField(position.tolist(), [0.0, 0.0, 0.0])
        return np.ravel(manager.getPropertyReference(field.vehicleGravityPropName))

    def fall(self, duration: float) -> None:
        """Propagate the origin by a duration [s] with one step of RK4."""

        def rate(state: Array) -> Array:
            return np.concatenate([state[3:], self.gravity(state[:3])])

        x, h = self.origin, duration
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        k4 = rate(x + h * k3)
        self.origin = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def wrenches(self, q: Array, t: float, duration: float) -> Array:
        """Wrenches of gravity and effectors at a configuration.

        Args:
            q: Configuration of the scene (nq,).
            t: Time [s].
            duration: Time step for which the wrenches will act [s].

        Returns:
            numpy.ndarray: Force at the centre of mass [N] and torque [N m] of each load, world axes (loads,
            6).

        Raises:
            SpaceRobotError: If state effectors are attached to the spacecraft.
        """
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q)
        wrenches = np.zeros((len(self.loads), 6))
        centres = [data.oMi[joint].act(model.inertias[joint].lever) for joint in self.loads]
        if self._attracts:
            here = self.gravity(self.origin[:3])
            for row, joint, centre in zip(wrenches, self.loads, centres, strict=True):
                row[:3] = model.inertias[joint].mass * (self.gravity(self.origin[:3] + centre) - here)
        # the spacecraft's state is prescribed by the reference messages of the scene module
        craft, place = self._spacecraft, data.oMi[self._base]
        craft.equationsOfMotion(t, duration)
        self._refuse_state_effectors()
        force = np.ravel(craft.sumForceExternal_N) + place.rotation @ np.ravel(craft.sumForceExternal_B)
        torque = place.rotation @ np.ravel(craft.sumTorquePntB_B)
        k = self.loads.index(self._base)
        wrenches[k, :3] += force
        wrenches[k, 3:] += torque + np.cross(place.translation - centres[k], force)
        return wrenches

    def _refuse_state_effectors(self) -> None:
        """Check that the spacecraft has no state effectors (wheels, panels, tanks).

        Basilisk integrates these together with the spacecraft's hub. Their list is not accessible from
        Python, but they change the back-substitution matrix D of the hub's rotation, which without them
        equals the inertia in the mass properties: a wheel, for example, subtracts J a a^T.

        Raises:
            SpaceRobotError: If the spacecraft has state effectors.
        """
        craft = self._spacecraft
        properties, matrix = craft.scMassOutMsg.read(), np.array(craft.hub.hubBackSubMatrices.matrixD)
        extra = properties.massSC - craft.hub.mHub
        gap = np.abs(matrix - np.array(properties.ISC_PntB_B)).max() if matrix.any() else 0.0
        if extra > 1e-12 * craft.hub.mHub or gap > 1e-12 * np.abs(matrix).max():
            raise SpaceRobotError(
                "spacecraft: found state effectors (wheels, panels, tanks), which Basilisk integrates with a "
                "hub of its own, allowed: dynamic effectors; wheels are actuators of the scenario"
            )
