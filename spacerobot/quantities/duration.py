"""Duration of a motion."""

from __future__ import annotations

from spacerobot.quantities.quantity import Quantity

QUANTITIES = (
    Quantity(
        "duration",
        "duration",
        "duration",
        "s",
        "final",
        "time",
        cost="time",
        is_metric=False,
        is_default=False,
    ),
)
