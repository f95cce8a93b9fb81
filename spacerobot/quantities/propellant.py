"""Propellant that thrusters spend."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity


def spent(context: Context) -> Components:
    """Propellant that the thrusters of each base have spent [kg]."""
    names, masses = context.bodies("propellant")
    return Components(names, ca.vertcat(ca.SX(0, 1), *masses))


QUANTITIES = (
    Quantity(
        "propellant",
        "propellant",
        "mass consumed by thrusters",
        "kg",
        "final",
        spent,
        total="sum",
        limit="propellant",
        weight="propellant",
        weight_unit="objective/kg",
        absent="no robot of this scene has thrusters, an actuator of kind thrusters",
        symbol="P",
    ),
)
