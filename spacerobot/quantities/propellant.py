"""Propellant that thrusters spend."""

from __future__ import annotations

from spacerobot.quantities.quantity import Quantity

QUANTITIES = (
    Quantity(
        "propellant",
        "propellant",
        "mass consumed by thrusters",
        "kg",
        "final",
        "propellant",
        total="sum",
        limit="propellant",
        weight="propellant",
        absent="no robot of this scene has thrusters, an actuator of kind thrusters",
        symbol="P",
    ),
)
