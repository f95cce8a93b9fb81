"""Locks of joints: brakes that hold a joint from an event on.

A lock is the acceleration constraint ``v_j' + k v_j = 0`` of one entry of v. It begins with the plastic
impulse that stops the joint, ``M (v+ - v-) = e_j p`` with ``e_j^T v+ = 0``: internal, so momentum is kept and
energy is lost.
"""

from __future__ import annotations

import casadi as ca

from spacerobot.elements.context import ActuatorContext, unit_load
from spacerobot.elements.contribution import AccelerationConstraint, Contribution, Output

DECAY = 20.0
"""Rate [1/s] at which the rounding error of a locked joint's speed decays."""


def lock(actuator: ActuatorContext, joint: str) -> tuple[ca.SX, tuple[AccelerationConstraint, ...]]:
    """Switch (1x1) that locks a joint, and the constraint unless another actuator has it already.

    All locks of one joint share it: two active constraints would make the constraint system singular.

    Parameters
    ----------
    actuator
        The actuator that locks it.
    joint
        Name of the joint.
    """
    plant, column = actuator.plant, actuator.columns[joint]
    constants, name = actuator.context.constants, f"{actuator.robot}/{joint}"
    known = f"{name}.held" in constants.switches
    held = constants.switch(f"{name}.held")
    if known:
        return held, ()
    unit, rate = ca.SX(plant.v.size1(), 1), plant.v[column]
    unit[column] = 1

    def answer(force: ca.SX, torque: ca.SX) -> Contribution:
        del force
        text = "torque of the brakes of locked joints"
        return Contribution(outputs=(Output("brake_torque", -torque[2], "N m or N", text, "brake", name),))

    # the one direction, a couple about z, stands for the joint's axis
    directions, sense = (unit_load(2, rotation=True),), plant.reduced(unit)
    return held, (AccelerationConstraint(directions, sense, DECAY * rate, rate, answer, active=held),)
