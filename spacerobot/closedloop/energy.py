"""Energy and its flows, in the bond graph's sense.

    kinetic + springs + potential = actuator work - taken by joints - taken by grips + constraint work

The works are states of the closed loop, integrated by the same method as everything else; what the
balance does not close is the integration's error. The constraints' work is that of rigid grasps whose
drift is being stabilised, and as small as that drift.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from spacerobot.closedloop.forward_dynamics import Solution
from spacerobot.closedloop.grasps import Constraint, Coupling
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.states import State
from spacerobot.dynamics import kinetic_energy

WORKS = ("actuator", "joint", "grasp", "constraint")
"""Works that are integrated: put in by actuators, taken by joints, taken by grips, put in by constraints."""


def build_works(
    plant: Plant, solution: Solution, couplings: Sequence[Coupling], constraints: Sequence[Constraint]
) -> list[State]:
    """Works as states that begin at zero [J]."""
    powers = {
        "actuator": ca.dot(solution.torque, plant.v),
        "joint": ca.dot(plant.damping * plant.v, plant.v),
        "grasp": sum((coupling.dissipation for coupling in couplings), ca.SX(1, 1)),
        "constraint": _constraint_power(solution, constraints),
    }
    return [
        State(f"work.{name}", ca.SX.sym(f"work.{name}"), ca.SX.zeros(1), ca.densify(powers[name]))
        for name in WORKS
    ]


def _constraint_power(solution: Solution, constraints: Sequence[Constraint]) -> ca.SX:
    total = ca.SX(1, 1)
    for constraint, (force, torque) in zip(constraints, solution.wrenches, strict=True):
        relative = constraint.relative
        total = total - ca.dot(force, relative.velocity) - ca.dot(torque, relative.spin)
    return total


def stored_energies(plant: Plant, couplings: Sequence[Coupling]) -> dict[str, ca.SX]:
    """Kinetic energy, energy of the grips' springs and potential energy of gravity [J]."""
    kinetic = kinetic_energy(plant.model, plant.kinematics, plant.inertias)
    springs = sum((coupling.energy for coupling in couplings), ca.SX(1, 1))
    return {"kinetic": kinetic, "spring": springs, "potential": _potential(plant)}


def _potential(plant: Plant) -> ca.SX:
    total, gravity = ca.SX(1, 1), plant.scene.scenario.gravity
    if not any(gravity):
        return total
    for body in plant.scene.bodies:
        for joint in body.subtree:
            mass, moment, _ = plant.inertias.in_world(plant.kinematics, joint)
            total = total - ca.dot(ca.SX(gravity), mass * plant.kinematics.origin[joint] + moment)
    return total
