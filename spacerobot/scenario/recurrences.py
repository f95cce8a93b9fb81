"""Limits on the number of samples, updates, plans and steps in a simulation.

The argument ``recurs`` of :func:`spacerobot.common.section.quantity` is the maximum number of a field's
period in the simulated time. Without it, a period of 1e-12 s would exhaust memory and time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from spacerobot.common.section import RECURS, Section


def check_recurrences(scenario: Section, duration_s: float) -> None:
    """Check that periods and steps are not too short for the simulated time.

    Args:
        scenario: Section that is searched, including all sections in it.
        duration_s: Simulated time [s].

    Raises:
        ValueError: If a period or step is too short; the message begins with the dotted path.
    """
    for path, time, most in recurring(scenario, ""):
        if duration_s / time > most:
            raise ValueError(
                f"{path}: found {time:g} s, {duration_s / time:.3g} times in the simulated {duration_s:g} s, "
                f"allowed: at most {most:g} times; raise it to {duration_s / most:.3g} s or more, or lower "
                "`simulation.duration`"
            )


def recurring(value: Any, path: str) -> Iterator[tuple[str, float, float]]:
    """Iterate over the periods and steps of a section: dotted path, time [s], maximum number."""
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
