"""The closed loop of a scene as x' = f(t, x), y = h(t, x), evaluated with numpy and Pinocchio."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.pinocchio_engine.mechanical_state import configuration_rate, coordinates
from spacerobot.scene import Scene, SceneGrasp
from tests.oracles.engine.actuation import Now, Spinning
from tests.oracles.engine.contacts import Pressure, contact_of, touches
from tests.oracles.engine.dynamics import Drive, Loads, Solution, Wrench, solve
from tests.oracles.engine.environments import Surroundings, environment_of
from tests.oracles.engine.grasps import (
    Constraint,
    Coupling,
    Relative,
    Rest,
    grasp_of,
    relative_motion,
    rest_orientation,
)
from tests.oracles.engine.joint_control import null_space
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.laws import has_writing, refusal
from tests.oracles.engine.life import first_lives, mated_orientation, works_of
from tests.oracles.engine.mode import Laws, Mode, laws_of, led
from tests.oracles.engine.outside import IMPULSE, impulse_rate, on_bases
from tests.oracles.engine.references import Motion
from tests.oracles.engine.robot_law import Asking
from tests.oracles.engine.tip_control import Channel, Command

WORKS = ("actuator", "joint", "grasp", "constraint")
"""Works that are booked whatever there is; those of contacts follow where there are any."""


@dataclass(frozen=True)
class Instant:
    """Everything the closed loop does at one instant.

    Attributes:
        kinematics: Of the plant.
        motions: Of the tips' references, by label.
        relatives: Of the grasps, in the scene's order.
        couplings: Of the compliant grasps.
        pressures: Of every pair of shapes of the contacts, by the contact's name.
        surroundings: What the environments do, in the scenario's order.
        solution: Acceleration, actuator torques, wrenches of rigid grasps.
        rates: Of z (nz,).
    """

    kinematics: Kinematics
    motions: Mapping[str, Motion]
    relatives: list[Relative]
    couplings: list[Coupling]
    pressures: Mapping[str, list[Pressure]]
    surroundings: list[Surroundings]
    solution: Solution
    rates: Array


class Engine:
    """A scene made ready to evaluate.

    The state is x = (q, v, z): Pinocchio's configuration and velocity, the controllers' states and the works
    of the energy balance.

    Attributes:
        state_names: Names of z.
        works: Names of the works.
        x0: Initial state (nx,).
        laws: Of the controllers, by the phase's name.
        mode: What is open and closed, and what leads; events replace it.
        impulse: Names of the states that hold the impulse from outside, none where nothing acts from there.
        touched: Places in z of impulse and loss of the contacts.
        mated: Tip's orientation where mated (3, 3), axes of the mating frame, by the grasp's name.
    """

    def __init__(self, scene: Scene) -> None:
        environments = list(scene.scenario.environment.values())
        for family, elements in (
            (grasp_of, [g.config for g in scene.grasps]),
            (environment_of, environments),
        ):
            for element in elements:
                if not has_writing(family, type(element)):
                    raise refusal(element)
        self.scene, self.model = scene, scene.model
        self._places = coordinates(scene.model)
        start = Kinematics(scene.model, np.array(scene.q), np.array(scene.v))
        self.laws = laws_of(scene)
        phase = next(iter(self.laws))
        now = self.laws[phase].scene
        self.mode = Mode(phase, first_lives(scene), led(now, phase, start, 0.0, {}))
        self.mated = {g.name: mated_orientation(g, rest_orientation(start, g)) for g in scene.grasps}
        self.root_rotations = [start.frame(body.root_frame).rotation for body in scene.bodies]
        self.resistance = _resistance(scene)
        blocks = self.now.blocks
        outside = ["environment"] if environments else []
        own = dict.fromkeys(name for one in self.now.deliveries for name in one.works)
        self.works = (*WORKS, *(["contact"] if scene.contacts else []), *outside, *own, *works_of(scene))
        booked = [
            f"contacts.{contact.name}.{part}"
            for contact in scene.contacts
            for part in ("impulse[0]", "impulse[1]", "impulse[2]", "loss[0]")
        ]
        names = [name for block in blocks for name in block.state_names]
        driven = [name for one in self.now.deliveries for name in one.state_names]
        self.touched = slice(len(names), len(names) + len(booked))
        sizes = [self.touched.stop, *(len(one.state_names) for one in self.now.deliveries)]
        self._driven_cuts = np.cumsum(sizes)
        first = [one.initial(start) for one in self.now.deliveries]
        given = any(one.from_outside for one in self.now.deliveries)
        self.impulse = IMPULSE if environments or given else ()
        works = [f"work.{name}[0]" for name in self.works]
        self.state_names = (*names, *booked, *driven, *self.impulse, *works)
        self._cuts = np.cumsum([len(block.state_names) for block in blocks])
        self.x0: Array = np.concatenate(
            [
                scene.q,
                scene.v,
                self.first_states(start),
                np.zeros(len(booked)),
                *first,
                np.zeros(len(self.impulse) + len(works)),
            ]
        )

    @property
    def now(self) -> Laws:
        """Laws of the present phase."""
        return self.laws[self.mode.phase]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the pieces of the present references meet [s], rising."""
        found = {t for lead in self.mode.leads.values() for t in lead.breakpoints}
        since = self.mode.began_at
        return tuple(sorted(found | {since + t for law in self.now.controllers for t in law.ends}))

    def first_states(self, kinematics: Kinematics, t: float = 0.0) -> Array:
        """States of the controllers as they begin at time t [s], of all phases' alike."""
        motions = self._motions(t, t, kinematics)
        parts = [c.initial(kinematics, motions[c.tip.label]) for c in self.now.channels]
        parts += [c.initial(kinematics) for c in self.now.controllers]
        return np.concatenate([np.empty(0), *parts])

    def derivative(self, t: float, x: Array, within: float | None = None) -> Array:
        """Rate x' (nx,) of the state at time t [s].

        Args:
            t, x: Time and state; the configuration need not be normalised.
            within: A time in the interval that is meant where t itself lies between two; t if None.

        Raises:
            numpy.linalg.LinAlgError: In a posture in which rigid grasps fix a freedom twice.
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
        kinematics = Kinematics(self.model, q, v)
        motions = self._motions(t, t if within is None else within, kinematics)
        states = np.split(z, self._cuts)[:-1]
        channels = self.now.channels
        relatives = [self.relative(kinematics, grasp, t) for grasp in self.now.scene.grasps]
        pressures = {
            contact.name: [contact_of(contact.config, touch) for touch in touches(kinematics, contact)]
            for contact in self.scene.contacts
        }
        pressing = [pressure for several in pressures.values() for pressure in several]
        kinematics.felt = self._felt(kinematics, relatives, pressing)
        asking = [
            (channel, channel.evaluate(kinematics, motions[channel.tip.label], own))
            for channel, own in zip(channels, states, strict=False)
        ]
        commands = [pair for pair, rests in zip(asking, self.now.rest, strict=False) if not rests]
        since = self.mode.began_at
        now = Asking(
            t - since, (t if within is None else within) - since, self.mode.phase, kinematics, motions
        )
        torque, of_bases, own_rates = self._robot_control(now, commands, states[len(channels) :])
        asked = [*(command for _, command in commands), *of_bases]
        couplings, loads = self._loads(torque, asked, relatives)
        around = self.scene.scenario.environment.values()
        surroundings = [environment_of(config, self.scene, kinematics, t) for config in around]
        pulls = [wrench for found in surroundings for wrench in found.wrenches]
        drives = self._drives(t, kinematics, z)
        solution = solve(kinematics, replace(loads, pressures=pressing, drives=drives, outside=pulls))
        powers = self._powers(v, solution, (couplings, loads.wrenches), pressing)
        powers["environment"] = sum(found.power for found in surroundings)
        tip_rates = [
            command.rates * (not rests) for (_, command), rests in zip(asking, self.now.rest, strict=False)
        ]
        booked = [
            np.sum([[*p.force, p.dissipation] for p in several], axis=0) for several in pressures.values()
        ]
        driven = [one.rates for one in solution.delivered]
        given = [push for one in solution.delivered for push in one.outside]
        given += [*pulls, *on_bases(self.scene, kinematics, solution.torque)]
        impulse = impulse_rate(given, self.scene.planar) if self.impulse else np.empty(0)
        works = [powers[name] for name in self.works]
        rates = np.concatenate([*tip_rates, *own_rates, *booked, *driven, impulse, works])
        return Instant(kinematics, motions, relatives, couplings, pressures, surroundings, solution, rates)

    def is_closed(self, name: str) -> bool:
        """Whether a grasp holds."""
        return name not in self.mode.lives or self.mode.lives[name].closed

    def relative(self, kinematics: Kinematics, grasp: SceneGrasp, t: float) -> Relative:
        """Relative motion of a grasp, open or closed, at time t [s]."""
        mated, life = self.mated[grasp.name], self.mode.lives.get(grasp.name)
        rest = Rest(mated) if life is None else life.rest(grasp.config.capture, mated, t)
        return relative_motion(kinematics, grasp, rest)

    def _felt(
        self, kinematics: Kinematics, relatives: Sequence[Relative], pressing: Sequence[Pressure]
    ) -> dict[str, Array]:
        """Wrenches of compliant grasps and contacts on tips about their origins (6,), by label."""
        wrenches: list[tuple[int, Array, Array, Array]] = []
        for grasp, relative in zip(self.now.scene.grasps, relatives, strict=True):
            coupling = grasp_of(grasp.config, self.scene, grasp, relative)
            if self.is_closed(grasp.name) and isinstance(coupling, Coupling):
                wrenches.append((grasp.tip.joint, relative.point, -coupling.force, -coupling.torque))
        for pressure in pressing:
            for sign, shape in zip((-1, 1), pressure.touch.pair, strict=True):
                wrenches.append((shape.joint, pressure.touch.point, sign * pressure.force, np.zeros(3)))
        felt = {}
        for tip in self.scene.tips:
            origin, beyond = kinematics.frame(tip.frame).position, self.model.subtrees[tip.joint]
            parts = [
                np.concatenate([force, torque + np.cross(point - origin, force)])
                for joint, point, force, torque in wrenches
                if joint in beyond
            ]
            felt[tip.label] = np.sum([np.zeros(6), *parts], axis=0)
        return felt

    def _robot_control(
        self, now: Asking, commands: Sequence[tuple[Channel, Command]], states: Sequence[Array]
    ) -> tuple[Array, list[Command], list[Array]]:
        """Generalized forces (nv,) of the robots' controllers, their commands, and rates of their states."""
        torque = np.zeros(self.model.nv)
        rates, of_bases = list[Array](), list[Command]()
        rest = self.now.rest[len(self.now.channels) :]
        for controller, own, rests in zip(self.now.controllers, states, rest, strict=True):
            asked = controller.ask(now, own)
            rates.append(asked.rates * (not rests))
            if rests:
                continue
            if asked.command is not None:
                of_bases.append(asked.command)
                continue
            part = asked.torque
            if asked.null_space:
                part = null_space(now.kinematics, part, controller.body, commands, self.scene.spread)
            torque = torque + part
        return torque, of_bases, rates

    def driven(self, k: int) -> slice:
        """Places in x of the states of actuator number k."""
        first = self.model.nq + self.model.nv
        return slice(first + self._driven_cuts[k], first + self._driven_cuts[k + 1])

    def _drives(self, t: float, kinematics: Kinematics, z: Array) -> list[Drive]:
        """What each actuator makes of what it is asked for, in the order in which they act."""
        states = np.split(z, self._driven_cuts)[1:]
        wheels: dict[str, Array] = {}
        for one, own in zip(self.now.deliveries, states, strict=False):
            if isinstance(one, Spinning):
                before = wheels.get(one.body.name, np.zeros(3))
                wheels[one.body.name] = before + one.momentum(kinematics, own)
        now = Now(t, self.mode.on, wheels)
        return [
            Drive(
                one.columns,
                one.passes_on,
                functools.partial(one.deliver, kinematics, states=own, now=now),
            )
            for one, own in zip(self.now.deliveries, states, strict=False)
        ]

    def _loads(
        self, torque: Array, asked: Sequence[Command], relatives: Sequence[Relative]
    ) -> tuple[list[Coupling], Loads]:
        """Compliant grasps, and everything that acts."""
        couplings: list[Coupling] = []
        wrenches: list[Wrench] = []
        constraints: list[Constraint] = []
        for grasp, relative in zip(self.now.scene.grasps, relatives, strict=True):
            if not self.is_closed(grasp.name):
                continue
            found = grasp_of(grasp.config, self.scene, grasp, relative)
            if isinstance(found, Coupling):
                couplings.append(found)
                wrenches.append((grasp, relative, found.force, found.torque))
            else:
                constraints.append(found)
        spread = self.scene.spread
        return couplings, Loads(torque, self.resistance, wrenches, asked, constraints, (), spread)

    def _motions(self, t: float, within: float, kinematics: Kinematics) -> dict[str, Motion]:
        return {label: lead.at(t, within, kinematics) for label, lead in self.mode.leads.items()}

    def _powers(
        self,
        v: Array,
        solution: Solution,
        springs: tuple[list[Coupling], Sequence[Wrench]],
        pressing: list[Pressure],
    ) -> dict[str, float]:
        """Rates of the works of what is within the scene, by name [W]."""
        couplings, wrenches = springs
        by_constraints = -sum(
            float(np.concatenate([force, torque]) @ relative.velocity)
            for _, relative, force, torque in solution.wrenches
        )
        drawn_in = -sum(
            float(np.concatenate([force, torque]) @ relative.rest_velocity)
            for _, relative, force, torque in [*wrenches, *solution.wrenches]
        )
        taken: dict[str, float] = {}
        for one in solution.delivered:
            for name, power in one.taken.items():
                taken[name] = taken.get(name, 0.0) + power
        return taken | {
            "actuator": float(solution.torque @ v) + sum(one.power for one in solution.delivered),
            "joint": float(self.resistance @ v**2),
            "grasp": sum(coupling.dissipation for coupling in couplings),
            "constraint": by_constraints,
            "contact": sum(pressure.dissipation for pressure in pressing),
            "draw_in": drawn_in,
            "event": 0.0,
        }


def _resistance(scene: Scene) -> Array:
    """Resistance of each velocity component (nv,), zero where there is none."""
    resistance = np.zeros(scene.model.nv)
    for body in scene.bodies:
        for name, config in body.config.joints.items():
            joint: Any = scene.model.joints[scene.model.getJointId(f"{body.name}/{name}")]
            resistance[joint.idx_v] = config.damping or 0.0
    return resistance
