"""Displacements of bases, what drives them, and what arms put on them."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Columns, Quantity, SignalSource

NO_FORCE = "there are no forces on bases: give `limits.base_force`, or actuators of the base"
NO_TORQUE = "there are no torques on bases: give `limits.base_torque`, or actuators of the base"


def wrenches(source: SignalSource, of: str) -> Columns:
    """Forces [N] and torques [N m] of two signals."""
    forces, torques = source.signal(f"{of}_force"), source.signal(f"{of}_torque")
    found = dict[str, ca.SX]()
    for robot in forces:
        found |= {f"{robot} force": forces[robot], f"{robot} torque": torques[robot]}
    return found


QUANTITIES = (
    Quantity(
        "base_translation_rms",
        "RMS base displacement",
        "root mean square of the displacement of a base since the start",
        "m",
        "rms",
        "base_translation",
        total="norm",
        weight="base_translation",
        cost="base_translation",
        relative_to_start=True,
        is_default=False,
        absent="there are no floating bases of robots",
    ),
    Quantity(
        "base_force_rms",
        "RMS force on bases",
        "root mean square of the force that drives a base, root link's axes",
        "N",
        "rms",
        "base_force",
        total="norm",
        weight="base_force",
        cost="base_force",
        is_default=False,
        absent=NO_FORCE,
    ),
    Quantity(
        "base_torque_rms",
        "RMS torque on bases",
        "root mean square of the torque that drives a base, root link's axes",
        "N m",
        "rms",
        "base_torque",
        total="norm",
        weight="base_torque",
        cost="base_torque",
        is_default=False,
        absent=NO_TORQUE,
    ),
    Quantity(
        "base_wrench_rms",
        "RMS wrench on bases",
        "root mean square of force [N] and torque [N m] that drive a base",
        "N",
        "rms",
        lambda source: wrenches(source, "base"),
        total="norm",
        weight="base_wrench",
        cost="base_wrench",
        is_default=False,
        absent=NO_FORCE,
    ),
    Quantity(
        "base_reaction_rms",
        "RMS reaction on bases",
        "root mean square of force [N] and torque [N m] of arms on their base about the root link's origin",
        "N",
        "rms",
        lambda source: wrenches(source, "reaction"),
        total="norm",
        cost="base_reaction",
        is_metric=False,
        is_default=False,
        absent="there are no robots",
    ),
    Quantity(
        "base_impulse",
        "impulse on bases",
        "integral of the magnitudes of forces along each axis of driven bases, for which propellant is spent",
        "N s",
        "magnitude",
        "base_force",
        total="sum",
        weight="base_impulse",
        cost="propellant",
        is_default=False,
        absent=NO_FORCE,
    ),
)
