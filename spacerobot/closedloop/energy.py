"""Energy balance of the closed loop.

    kinetic + springs + potential - their initial values = works put in - works taken out

The works are states of the closed loop, integrated with all others; the residual of the balance is the
integration error. The work of constraints comes from the stabilisation of rigid grasps and is as small as
their drift.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from spacerobot.dynamics import kinetic_energy
from spacerobot.elements import Contribution, Output, PowerTerm, State
from spacerobot.scene import Scene
from spacerobot.symbolic import Plant

WORKS: dict[str, tuple[Literal["in", "out"], str]] = {
    "actuator": ("in", "work put in by actuators since the start"),
    "joint": ("out", "work taken by joints since the start"),
    "grasp": ("out", "work taken by grips since the start"),
    "constraint": ("in", "work put in by rigid grasps since the start"),
}
"""Works of every closed loop, even if nothing contributes to them."""


@dataclass(frozen=True)
class EnergyTerm:
    """Work in the energy balance: name, sign, description, and state."""

    name: str
    sign: Literal["in", "out"]
    text: str
    state: State

    @property
    def output(self) -> Output:
        """Output of the work [J]."""
        return Output(f"work_{self.name}", self.state.symbol, "J", self.text)


def build_works(powers: Iterable[PowerTerm]) -> list[EnergyTerm]:
    """Works [J] as states that start at zero, those of :data:`WORKS` first."""
    totals: dict[str, ca.SX] = {name: ca.SX(1, 1) for name in WORKS}
    kinds = dict(WORKS)
    for power in powers:
        verb = "put in" if power.sign == "in" else "taken"
        kinds.setdefault(power.name, (power.sign, f"work {verb}: {power.name.replace('_', ' ')}"))
        totals[power.name] = totals.get(power.name, ca.SX(1, 1)) + power.value
    return [
        EnergyTerm(
            name,
            *kinds[name],
            State(f"work.{name}", ca.SX.sym(f"work.{name}"), ca.SX.zeros(1), ca.densify(total)),
        )
        for name, total in totals.items()
    ]


def plant_powers(plant: Plant, torque: ca.SX) -> tuple[PowerTerm, ...]:
    """Powers of the actuators (their generalized forces nv x 1) and of the joints' resistance."""
    return (
        PowerTerm("actuator", ca.dot(torque, plant.v), "in"),
        PowerTerm("joint", ca.dot(plant.damping * plant.v, plant.v)),
    )


def stored_energies(scene: Scene, plant: Plant, acting: Contribution) -> tuple[Output, ...]:
    """Kinetic energy, energy of the springs and potential energy of gravity [J]."""
    kinetic = kinetic_energy(plant.model, plant.kinematics, plant.inertias)
    kinetic = sum((stored.energy for stored in acting.stored), kinetic)
    springs = ca.SX(1, 1) if acting.energy is None else acting.energy
    if plant.stiffness.nnz():
        springs = springs + ca.dot(plant.stiffness * plant.deflection, plant.deflection) / 2
    potential, gravity = ca.SX(1, 1), scene.scenario.gravity
    for body in scene.bodies if any(gravity) else ():
        for joint in body.subtree:
            mass, moment, _ = plant.inertias.in_world(plant.kinematics, joint)
            potential = potential - ca.dot(ca.SX(gravity), mass * plant.kinematics.origin[joint] + moment)
    return (
        Output("energy_kinetic", kinetic, "J", "kinetic energy"),
        Output("energy_spring", springs, "J", "energy held in springs"),
        Output("energy_potential", potential, "J", "potential energy of gravity"),
    )
