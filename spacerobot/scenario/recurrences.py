"""Bounds on how often something happens in a simulation: samples, decisions, plans, steps.

A field states by ``recurs`` of :func:`spacerobot.common.section.quantity` how often its time may fit into the
simulated one. Without a bound, a period of 1e-12 s would ask for more memory and time than there is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from spacerobot.common.section import RECURS, Section


def check_recurrences(scenario: Section, duration_s: float) -> None:
    """Refuse periods and steps that are too short for the simulated time.

    Args:
        scenario: Section that is searched with everything in it.
        duration_s: Simulated time [s].

    Raises:
        ValueError: Its text begins with the dotted path.
    """
    for path, time, most in recurring(scenario, ""):
        if duration_s / time > most:
            raise ValueError(
                f"{path}: found {time:g} s, {duration_s / time:.3g} times in the simulated {duration_s:g} s, "
                f"allowed: at most {most:g} times; raise it to {duration_s / most:.3g} s or more, or lower "
                "`simulation.duration`"
            )


def recurring(value: Any, path: str) -> Iterator[tuple[str, float, float]]:
    """Dotted path, time [s] and largest number of every field that recurs."""
    if isinstance(value, Section):
        for name, field in type(value).model_fields.items():
            inner, place = getattr(value, name), f"{path}.{name}" if path else name
            extra = field.json_schema_extra
            if isinstance(extra, dict) and RECURS in extra and inner is not None:
                yield place, float(inner), float(str(extra[RECURS]))
            else:
                yield from recurring(inner, place)
    elif isinstance(value, Mapping):
        for name, inner in value.items():
            yield from recurring(inner, f"{path}.{name}")
    elif isinstance(value, list | tuple) and not all(isinstance(inner, float | int) for inner in value):
        for i, inner in enumerate(value):
            yield from recurring(inner, f"{path}.{i}")
