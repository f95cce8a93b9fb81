"""Displacements of bases, forces and torques on bases, and reactions of arms on bases."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Columns, PlanBound, Quantity, SignalSource

NO_BASE = "there are no floating bases of robots"
NO_FORCE = "there are no forces on bases: give `limits.base_force`, or actuators of the base"
NO_TORQUE = "there are no torques on bases: give `limits.base_torque`, or actuators of the base"


def wrenches(source: SignalSource, of: str) -> Columns:
    """Forces [N] and torques [N m] of each robot, from the signals ``<of>_force`` and ``<of>_torque``."""
    forces, torques = source.signal(f"{of}_force"), source.signal(f"{of}_torque")
    columns = dict[str, ca.SX]()
    for robot in forces:
        columns |= {f"{robot} force": forces[robot], f"{robot} torque": torques[robot]}
    return columns


QUANTITIES = (
    Quantity(
        name="base_translation_rms",
        label="RMS base displacement",
        description="root mean square of the displacement of a base since the start",
        unit="m",
        reducer="rms",
        expression="base_translation",
        total="norm",
        weight="base_translation",
        cost="base_translation",
        bounds=(
            PlanBound("base_translation", "m", "maximum displacement of any robot's base since the start"),
        ),
        relative_to_start=True,
        is_default=False,
        absent=NO_BASE,
    ),
    Quantity(
        name="base_speed_rms",
        label="RMS base speed",
        description="root mean square of the speed of a base",
        unit="m/s",
        reducer="rms",
        expression="base_velocity",
        total="norm",
        bounds=(
            PlanBound("base_speed", "m/s", "maximum speed of any floating base's root link, at its origin"),
        ),
        is_metric=False,
        is_default=False,
        absent=NO_BASE,
    ),
    Quantity(
        name="base_spin_rms",
        label="RMS base spin",
        description="root mean square of the angular velocity of a base",
        unit="rad/s",
        reducer="rms",
        expression="base_spin",
        total="norm",
        bounds=(PlanBound("base_spin_deg", "deg/s", "maximum angular velocity of any floating base"),),
        is_metric=False,
        is_default=False,
        absent=NO_BASE,
    ),
    Quantity(
        name="base_force_rms",
        label="RMS force on bases",
        description="root mean square of the force that drives a base, root link's axes",
        unit="N",
        reducer="rms",
        expression="base_force",
        total="norm",
        weight="base_force",
        cost="base_force",
        bounds=(
            PlanBound(
                "base_force",
                "N",
                "maximum force along each axis that drives a floating base, 0 for none; that of its "
                "actuators if not given",
                allowed={"ge": 0},
            ),
        ),
        is_default=False,
        absent=NO_FORCE,
    ),
    Quantity(
        name="base_torque_rms",
        label="RMS torque on bases",
        description="root mean square of the torque that drives a base, root link's axes",
        unit="N m",
        reducer="rms",
        expression="base_torque",
        total="norm",
        weight="base_torque",
        cost="base_torque",
        bounds=(
            PlanBound(
                "base_torque",
                "N m",
                "maximum torque about each axis that drives a floating base, 0 for none; likewise",
                allowed={"ge": 0},
            ),
        ),
        is_default=False,
        absent=NO_TORQUE,
    ),
    Quantity(
        name="base_wrench_rms",
        label="RMS wrench on bases",
        description="root mean square of force [N] and torque [N m] that drive a base",
        unit="N",
        reducer="rms",
        expression=lambda source: wrenches(source, "base"),
        total="norm",
        weight="base_wrench",
        cost="base_wrench",
        is_default=False,
        absent=NO_FORCE,
    ),
    Quantity(
        name="base_reaction_rms",
        label="RMS reaction on bases",
        description="root mean square of force [N] and torque [N m] of arms on their base about the "
        "root link's origin",
        unit="N",
        reducer="rms",
        expression=lambda source: wrenches(source, "reaction"),
        total="norm",
        cost="base_reaction",
        is_metric=False,
        is_default=False,
        absent="there are no robots",
    ),
    Quantity(
        name="base_impulse",
        label="impulse on bases",
        description="integral of the magnitudes of forces along each axis of driven bases, for "
        "which propellant is spent",
        unit="N s",
        reducer="magnitude",
        expression="base_force",
        total="sum",
        weight="base_impulse",
        cost="propellant",
        is_default=False,
        absent=NO_FORCE,
    ),
)
