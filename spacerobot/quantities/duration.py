"""Duration of a motion."""

from __future__ import annotations

from spacerobot.quantities.quantity import Quantity

QUANTITIES = (
    Quantity(
        name="duration",
        label="duration",
        description="duration",
        unit="s",
        reducer="final",
        expression="time",
        cost="time",
        is_metric=False,
        is_default=False,
    ),
)
