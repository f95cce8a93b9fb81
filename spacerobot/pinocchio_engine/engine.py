"""The closed loop of a scene as x' = f(t, x), y = h(t, x), evaluated with numpy and Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.pinocchio_engine.actuation import torque_limits
from spacerobot.pinocchio_engine.contacts import Pressure, contact_of, touches
from spacerobot.pinocchio_engine.dynamics import Loads, Solution, Wrench, solve
from spacerobot.pinocchio_engine.grasps import (
    Constraint,
    Coupling,
    Relative,
    grasp_of,
    relative_motion,
    rest_orientation,
)
from spacerobot.pinocchio_engine.joint_control import JointController, joint_controllers, null_space
from spacerobot.pinocchio_engine.kinematics import Kinematics, configuration_rate, coordinates
from spacerobot.pinocchio_engine.references import Begins, Leads, Motion, leading
from spacerobot.pinocchio_engine.tip_control import Channel, Command, tip_law
from spacerobot.scene import Scene

WORKS = ("actuator", "joint", "grasp", "constraint")
"""Works that are booked whatever there is; those of contacts follow where there are any."""


@dataclass(frozen=True)
class Instant:
    """Everything the closed loop does at one instant.

    Attributes
    ----------
    kinematics
        Of the plant.
    motions
        Of the tips' references, by label.
    relatives
        Of the grasps, in the scene's order.
    couplings
        Of the compliant grasps.
    pressures
        Of every pair of shapes of the contacts, by the contact's name.
    solution
        Acceleration, actuator torques, wrenches of rigid grasps.
    rates
        Of z (nz,).
    """

    kinematics: Kinematics
    motions: Mapping[str, Motion]
    relatives: list[Relative]
    couplings: list[Coupling]
    pressures: Mapping[str, list[Pressure]]
    solution: Solution
    rates: Array


class Engine:
    """A scene made ready to evaluate.

    The state is x = (q, v, z): Pinocchio's configuration and velocity, the controllers' states and the works
    of the energy balance.

    Attributes
    ----------
    state_names
        Names of z.
    works
        Names of the works.
    x0
        Initial state (nx,).
    breakpoints
        Times at which the pieces of references meet [s], rising.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.model = scene, scene.model
        self._places = coordinates(scene.model)
        start = Kinematics(scene.model, np.array(scene.q), np.array(scene.v))
        self.references = _references(scene, start)
        self.channels: list[Channel] = [
            tip_law(controller, scene, tip, key)
            for tip in scene.tips
            for key, controller in tip.config.elements()
        ]
        self.controllers: list[JointController] = joint_controllers(scene)
        self.rest = [rest_orientation(start, grasp) for grasp in scene.grasps]
        self.root_rotations = [start.frame(body.root_frame).rotation for body in scene.bodies]
        self.resistance, self.limits = _resistance(scene), torque_limits(scene)
        blocks: list[Channel | JointController] = [*self.channels, *self.controllers]
        names = [name for block in blocks for name in block.state_names]
        self.works = (*WORKS, "contact") if scene.contacts else WORKS
        names += [
            f"{contact.name}.{part}"
            for contact in scene.contacts
            for part in ("impulse[0]", "impulse[1]", "impulse[2]", "loss[0]")
        ]
        self.state_names = (*names, *(f"work.{name}[0]" for name in self.works))
        self._cuts = np.cumsum([len(block.state_names) for block in blocks])
        motions = self._motions(0.0, 0.0, start)
        z0 = [c.initial(start, motions[c.tip.label]) for c in self.channels]
        z0 += [c.positions(start.q) for c in self.controllers]
        self.x0: Array = np.concatenate(
            [scene.q, scene.v, *z0, np.zeros(4 * len(scene.contacts) + len(self.works))]
        )
        self.breakpoints = tuple(sorted({t for tip in scene.tips for t in tip.reference.jumps()}))

    def derivative(self, t: float, x: Array, within: float | None = None) -> Array:
        """Rate x' (nx,) of the state at time t [s].

        Parameters
        ----------
        t, x
            Time and state; the configuration need not be normalised.
        within
            A time in the interval that is meant where t itself lies between two; t if None.

        Raises
        ------
        numpy.linalg.LinAlgError
            In a posture in which rigid grasps fix a freedom twice.
        """
        instant = self.instant(t, x, within)
        q, v, _ = self.split(x)
        return np.concatenate(
            [configuration_rate(self._places, q, v), instant.solution.acceleration, instant.rates]
        )

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Parts q (nq,), v (nv,) and z (nz,) of a state."""
        nq, nv = self.model.nq, self.model.nv
        return x[:nq], x[nq : nq + nv], x[nq + nv :]

    def normalise(self, x: Array) -> Array:
        """State with cosine-sine pairs and quaternions back on their unit spheres."""
        q, v, z = self.split(x)
        return np.concatenate([pin.normalize(self.model, q), v, z])

    def instant(self, t: float, x: Array, within: float | None = None) -> Instant:
        """Everything at one instant; arguments and errors as for :meth:`derivative`."""
        q, v, z = self.split(x)
        kinematics = Kinematics(self.model, pin.normalize(self.model, q), v)
        motions = self._motions(t, t if within is None else within, kinematics)
        states = np.split(z, self._cuts)
        commands = [
            (channel, channel.evaluate(kinematics, motions[channel.tip.label], own))
            for channel, own in zip(self.channels, states, strict=False)
        ]
        torque, desired_rates = self._joint_control(
            kinematics, motions, commands, states[len(self.channels) : -1]
        )
        relatives = [
            relative_motion(kinematics, grasp, rest)
            for grasp, rest in zip(self.scene.grasps, self.rest, strict=True)
        ]
        asked = [command for _, command in commands]
        couplings, loads = self._loads(torque, asked, relatives)
        pressures = {
            contact.name: [contact_of(contact.config, touch) for touch in touches(kinematics, contact)]
            for contact in self.scene.contacts
        }
        pressing = [pressure for several in pressures.values() for pressure in several]
        solution = solve(kinematics, replace(loads, pressures=pressing))
        powers = self._powers(v, solution, couplings, pressing)
        booked = [
            np.sum([[*p.force, p.dissipation] for p in several], axis=0) for several in pressures.values()
        ]
        rates = np.concatenate([*(command.rates for command in asked), *desired_rates, *booked, powers])
        return Instant(kinematics, motions, relatives, couplings, pressures, solution, rates)

    def _joint_control(
        self,
        kinematics: Kinematics,
        motions: Mapping[str, Motion],
        commands: Sequence[tuple[Channel, Command]],
        desired: Sequence[Array],
    ) -> tuple[Array, list[Array]]:
        """Torques (nv,) of the joint controllers, and the rates of their states."""
        torque = np.zeros(self.model.nv)
        for controller, own in zip(self.controllers, desired, strict=True):
            part = controller.torque(kinematics, own)
            if controller.config.null_space:
                part = null_space(kinematics, part, controller.body, commands, self.scene.spread)
            torque = torque + part
        pairs = zip(self.controllers, desired, strict=True)
        return torque, [controller.desired_rate(own, motions) for controller, own in pairs]

    def _loads(
        self, torque: Array, asked: Sequence[Command], relatives: Sequence[Relative]
    ) -> tuple[list[Coupling], Loads]:
        """Compliant grasps, and everything that acts."""
        couplings: list[Coupling] = []
        wrenches: list[Wrench] = []
        constraints: list[Constraint] = []
        for grasp, relative in zip(self.scene.grasps, relatives, strict=True):
            found = grasp_of(grasp.config, self.scene, grasp, relative)
            if isinstance(found, Coupling):
                couplings.append(found)
                wrenches.append((grasp, relative, found.force, found.torque))
            else:
                constraints.append(found)
        limits, spread = self.limits, self.scene.spread
        return couplings, Loads(torque, self.resistance, wrenches, asked, constraints, limits, spread)

    def _motions(self, t: float, within: float, kinematics: Kinematics) -> dict[str, Motion]:
        return {label: reference.at(t, within, kinematics) for label, reference in self.references.items()}

    def _powers(
        self, v: Array, solution: Solution, couplings: list[Coupling], pressing: list[Pressure]
    ) -> Array:
        """Rates of the works, in their order [W]."""
        by_constraints = -sum(
            float(force @ relative.velocity[:3] + torque @ relative.velocity[3:])
            for _, relative, force, torque in solution.wrenches
        )
        powers = {
            "actuator": solution.torque @ v,
            "joint": self.resistance @ v**2,
            "grasp": sum(coupling.dissipation for coupling in couplings),
            "constraint": by_constraints,
            "contact": sum(pressure.dissipation for pressure in pressing),
        }
        return np.array([powers[name] for name in self.works])


def _references(scene: Scene, start: Kinematics) -> dict[str, Leads]:
    references = {}
    for tip in scene.tips:
        pivot = None
        if tip.from_target and scene.target is not None:
            pivot = start.frame(scene.target.root_frame).position
        references[tip.label] = leading(tip.reference, Begins(scene, tip, start, pivot))
    return references


def _resistance(scene: Scene) -> Array:
    """Resistance of each velocity component (nv,), zero where there is none."""
    resistance = np.zeros(scene.model.nv)
    for body in scene.bodies:
        for name, config in body.config.joints.items():
            joint: Any = scene.model.joints[scene.model.getJointId(f"{body.name}/{name}")]
            resistance[joint.idx_v] = config.damping or 0.0
    return resistance
