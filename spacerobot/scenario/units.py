"""Units and limits of a scenario's numbers, by dotted path."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from spacerobot.common.section import SIGNALS_UNIT, Section
from spacerobot.elements.controllers.controller import TipController
from spacerobot.scenario.scenario import Scenario


def unit_at(scenario: Scenario, path: str) -> str:
    """Unit of the number at a dotted path, such as ``kg`` or ``1``; ``SI`` if its field has no unit.

    Args:
        scenario: A resolved scenario.
        path: Dotted path without ``*``, from :func:`spacerobot.scenario.paths.expand`.
    """
    unit = "SI"
    for section, key, turns in _fields(scenario, path):
        field_unit = section.unit_of(key, rotation=turns)
        # the calibration of a sensor has the unit of its signal
        if field_unit is not None and field_unit != SIGNALS_UNIT:
            unit = field_unit
    return unit


def limits_at(scenario: Scenario, path: str) -> tuple[float, float]:
    """Lower and upper limit of the number at a dotted path in the schema; infinite without a limit.

    Open limits, such as zero for a mass, are returned in the same way as closed ones.

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
    """Iterate over the sections along a path: class, key, and whether it is that of a rotation controller."""
    keys = path.split(".", 3)
    if keys[0] == "phases" and keys[2] in ("robots", "target", "grasps"):
        scenario, path = scenario.during(keys[1]), path.removeprefix(f"phases.{keys[1]}.")
    node: Any = scenario
    turns = False
    while path:
        # a key with dots is one segment
        longer = [key for key in node if f"{path}.".startswith(f"{key}.")] if isinstance(node, dict) else []
        key = max(longer, key=len, default=path.partition(".")[0])
        path = path[len(key) + 1 :]
        if isinstance(node, Section):
            yield type(node), key, turns
            node = getattr(node, key)
        else:
            node = node[key] if isinstance(node, dict) else node[int(key)]
        turns = turns or (isinstance(node, TipController) and node.controls(key) == "rotation")
