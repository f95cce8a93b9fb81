"""Joints held from an event on, by a brake or by a runaway motor.

A joint held at the rate r has the acceleration constraint ``v_j' + k (v_j - r) = 0`` for its entry of v. A
brake starts with the plastic impulse that stops the joint, ``M (v+ - v-) = e_j p`` with ``e_j^T v+ = 0``. The
impulse is internal: momentum is conserved and energy is dissipated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import casadi as ca

from spacerobot.elements.core.context import ActuatorContext, unit_load
from spacerobot.elements.core.contribution import (
    AccelerationConstraint,
    Contribution,
    Output,
    PowerTerm,
    memory,
)
from spacerobot.symbolic import Constants

DECAY = 20.0
"""Rate [1/s] at which the rounding error of a held joint's speed decays."""


def held_joints(
    actuator: ActuatorContext, joints: Iterable[str], *, running: bool = False, is_known: bool = False
) -> tuple[Contribution, dict[str, bool], dict[str, ca.SX]]:
    """Constraints that hold joints, with the switches and states that their event sets.

    Everything that holds a joint shares its constraint, so that a brake can stop a runaway joint; two active
    constraints on one joint would make the constraint system singular.

    Args:
        actuator: Actuator that holds the joints.
        joints: Names of the joints.
        running: Whether the joints keep their present rate instead of being stopped.
        is_known: Whether controllers know about it from then on; :func:`known_lock` is the switch.
    """
    constants, plant = actuator.context.constants, actuator.plant
    parts, sets, updates = list[Contribution](), dict[str, bool](), dict[str, ca.SX]()
    for joint in joints:
        name, column = f"{actuator.robot}/{joint}", actuator.columns[joint]
        is_created = f"{name}.held" in constants.switches
        held, runs = constants.switch(f"{name}.held"), constants.switch(f"{name}.runs")
        held_rate = memory(f"{name}.held_rate", ca.SX.zeros(1))
        sets |= {held.name(): True, runs.name(): running}
        sets |= {known_lock(constants, actuator.robot, joint).name(): True} if is_known else {}
        updates |= {held_rate.name: plant.v[column]} if running else {}
        if not is_created:
            constraint = _hold(actuator, column, name, held, runs * held_rate.symbol)
            constraint = replace(constraint, known=known_lock(constants, actuator.robot, joint))
            parts.append(Contribution(states=(held_rate,), constraints=(constraint,)))
    states = tuple(state for part in parts for state in part.states)
    constraints = tuple(one for part in parts for one in part.constraints)
    return Contribution(states=states, constraints=constraints), sets, updates


def known_lock(constants: Constants, robot: str, joint: str) -> ca.SX:
    """Switch (1x1): controllers of a robot know that a joint, by its name in the URDF, is held."""
    return constants.switch(f"{robot}/{joint}.known")


def _hold(
    actuator: ActuatorContext, column: int, name: str, held: ca.SX, rate: ca.SX
) -> AccelerationConstraint:
    """Constraint that holds a joint at a rate; its single load direction represents the joint's axis."""
    plant = actuator.plant
    unit, joint_rate = ca.SX(plant.v.size1(), 1), plant.v[column]
    unit[column] = 1

    def answer(force: ca.SX, torque: ca.SX) -> Contribution:
        del force
        text = "torque that holds failed joints"
        return Contribution(
            powers=(PowerTerm("actuator", -torque[2] * rate, "in"),),
            outputs=(Output("brake_torque", -torque[2], "N m or N", text, "brake", name),),
        )

    slip = joint_rate - rate
    return AccelerationConstraint(
        (unit_load(2, rotation=True),), plant.reduced(unit), DECAY * slip, slip, answer, held, imposed=rate
    )
