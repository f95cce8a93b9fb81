"""Quantities of a rollout, one file for each group; tuning, campaigns, pages and reports use them."""

from spacerobot.quantities.quantity import (
    NOTHING,
    AddedStates,
    Components,
    Context,
    Quantity,
    default_metrics,
    find_quantity,
    limited,
    metrics,
    quantities,
    register_quantity,
    weighted,
)

__all__ = [
    "NOTHING",
    "AddedStates",
    "Components",
    "Context",
    "Quantity",
    "default_metrics",
    "find_quantity",
    "limited",
    "metrics",
    "quantities",
    "register_quantity",
    "weighted",
]
