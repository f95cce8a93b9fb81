"""Quantities of a motion, one file for each group, for tuning, campaigns, plans, pages and reports."""

from spacerobot.quantities.quantity import (
    AddedStates,
    Columns,
    Components,
    Context,
    PlanBound,
    Quantity,
    SignalSource,
    bounded,
    default_metrics,
    find_quantity,
    limited,
    metrics,
    planned,
    quantities,
    register_quantity,
    weighted,
)

__all__ = [
    "AddedStates",
    "Columns",
    "Components",
    "Context",
    "PlanBound",
    "Quantity",
    "SignalSource",
    "bounded",
    "default_metrics",
    "find_quantity",
    "limited",
    "metrics",
    "planned",
    "quantities",
    "register_quantity",
    "weighted",
]
