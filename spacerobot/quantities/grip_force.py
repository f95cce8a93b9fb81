"""Forces in grasps."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = 1e-6  # N; keeps the size smooth where there is no force


def per_grasp(context: Context) -> Components:
    """Size of the force in each grasp [N]."""
    forces = sizes(context.vectors("grasp_force"), SMALLEST)
    return Components(tuple(grasp.name for grasp in context.scene.grasps), ca.vertcat(ca.SX(0, 1), *forces))


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
)
