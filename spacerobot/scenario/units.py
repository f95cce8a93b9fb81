"""Units of a scenario's numbers, by dotted path."""

from __future__ import annotations

from typing import Any

from spacerobot.elements.controllers.controller import TipController
from spacerobot.scenario.scenario import Scenario
from spacerobot.section import SIGNALS_UNIT, Section


def unit_at(scenario: Scenario, path: str) -> str:
    """Unit of the number at a dotted path without ``*``: ``kg``, ``1``; ``SI`` where it has no one name.

    Parameters
    ----------
    scenario
        A resolved scenario that holds the path.
    path
        As :func:`spacerobot.scenario.paths.expand` gives them.
    """
    keys = path.split(".", 3)
    if keys[0] == "phases" and keys[2] in ("robots", "target", "grasps"):
        scenario, path = scenario.during(keys[1]), path.removeprefix(f"phases.{keys[1]}.")
    node: Any = scenario
    unit, turns = "SI", False
    while path:
        # a key that itself holds dots is one segment
        longer = [key for key in node if f"{path}.".startswith(f"{key}.")] if isinstance(node, dict) else []
        key = max(longer, key=len, default=path.partition(".")[0])
        path = path[len(key) + 1 :]
        if isinstance(node, Section):
            found = type(node).unit_of(key, rotation=turns)
            # a sensor's calibration is in the unit of what it measures
            if found is not None and found != SIGNALS_UNIT:
                unit = found
            node = getattr(node, key)
        else:
            node = node[key] if isinstance(node, dict) else node[int(key)]
        turns = turns or (isinstance(node, TipController) and node.controls(key) == "rotation")
    return unit
