"""Units and limits of a scenario's numbers, by dotted path."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from spacerobot.common.section import SIGNALS_UNIT, Section
from spacerobot.elements.controllers.controller import TipController
from spacerobot.scenario.scenario import Scenario


def unit_at(scenario: Scenario, path: str) -> str:
    """Unit of the number at a dotted path without ``*``: ``kg``, ``1``; ``SI`` where it has no one name.

    Args:
        scenario: A resolved scenario that holds the path.
        path: As :func:`spacerobot.scenario.paths.expand` gives them.
    """
    unit = "SI"
    for section, key, turns in _fields(scenario, path):
        field_unit = section.unit_of(key, rotation=turns)
        # a sensor's calibration is in the unit of what it measures
        if field_unit is not None and field_unit != SIGNALS_UNIT:
            unit = field_unit
    return unit


def limits_at(scenario: Scenario, path: str) -> tuple[float, float]:
    """Lowest and highest number that the schema allows at a path; infinite where it has no limit.

    A limit that is itself not allowed, as the zero of a mass, is given too.

    Args:
        scenario, path: As for :func:`unit_at`.
    """
    *_, (section, key, _) = _fields(scenario, path)
    lower, upper = -math.inf, math.inf
    for constraint in section.model_fields[key].metadata:
        lower = max(lower, *(getattr(constraint, name, lower) for name in ("gt", "ge")))
        upper = min(upper, *(getattr(constraint, name, upper) for name in ("lt", "le")))
    return lower, upper


def _fields(scenario: Scenario, path: str) -> Iterator[tuple[type[Section], str, bool]]:
    """Sections along a path, each with the key and whether that is a controller's of rotation."""
    keys = path.split(".", 3)
    if keys[0] == "phases" and keys[2] in ("robots", "target", "grasps"):
        scenario, path = scenario.during(keys[1]), path.removeprefix(f"phases.{keys[1]}.")
    node: Any = scenario
    turns = False
    while path:
        # a key that itself holds dots is one segment
        longer = [key for key in node if f"{path}.".startswith(f"{key}.")] if isinstance(node, dict) else []
        key = max(longer, key=len, default=path.partition(".")[0])
        path = path[len(key) + 1 :]
        if isinstance(node, Section):
            yield type(node), key, turns
            node = getattr(node, key)
        else:
            node = node[key] if isinstance(node, dict) else node[int(key)]
        turns = turns or (isinstance(node, TipController) and node.controls(key) == "rotation")
