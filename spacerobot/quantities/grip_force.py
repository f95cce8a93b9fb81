"""Forces and torques in grasps, forces of contacts."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import NOTHING, Components, Context, Quantity, sizes

SMALLEST = 1e-6  # N or N m; keeps the size smooth where there is no force


def per_grasp(context: Context) -> Components:
    """Size of the force in each grasp [N]."""
    forces = sizes(context.vectors("grasp_force"), SMALLEST)
    return Components(tuple(grasp.name for grasp in context.scene.grasps), ca.vertcat(ca.SX(0, 1), *forces))


def torque_per_grasp(context: Context) -> Components:
    """Size of the torque in each grasp, at its tip [N m]; exactly zero where there is none."""
    torques = [size - SMALLEST for size in sizes(context.vectors("grasp_torque"), SMALLEST)]
    return Components(tuple(grasp.name for grasp in context.scene.grasps), ca.vertcat(ca.SX(0, 1), *torques))


def per_contact(context: Context) -> Components:
    """Size of the force of each contact [N], exactly zero where there is none."""
    if "contact_force" not in context.loop.outputs.name_out():
        return NOTHING
    forces = [size - SMALLEST for size in sizes(context.vectors("contact_force"), SMALLEST)]
    return Components(tuple(context.scene.scenario.contacts), ca.vertcat(ca.SX(0, 1), *forces))


QUANTITIES = (
    Quantity(
        "grip_force_peak",
        "peak grip force",
        "largest force in a grasp",
        "N",
        "peak",
        per_grasp,
        limit="grip_force",
        absent="this scene has no grasp",
        symbol="G",
    ),
    Quantity(
        "grip_torque_peak",
        "peak grip torque",
        "largest torque in a grasp",
        "N m",
        "peak",
        torque_per_grasp,
        limit="grip_torque",
        is_default=False,
        absent="this scene has no grasp",
        symbol="M",
    ),
    Quantity(
        "contact_force_peak",
        "peak contact force",
        "largest force of a contact",
        "N",
        "peak",
        per_contact,
        limit="contact_force",
        is_default=False,
        absent="this scene has no contact",
        symbol="F",
    ),
)
