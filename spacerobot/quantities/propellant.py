"""Propellant consumption of thrusters."""

from __future__ import annotations

from spacerobot.quantities.quantity import Quantity

QUANTITIES = (
    Quantity(
        name="propellant",
        label="propellant",
        description="mass consumed by thrusters",
        unit="kg",
        reducer="final",
        expression="propellant",
        total="sum",
        limit="propellant",
        weight="propellant",
        absent="no robot of this scene has thrusters, an actuator of kind thrusters",
        symbol="P",
    ),
)
