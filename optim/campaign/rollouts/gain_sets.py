"""Sets of gains by name: of the scenario, of its campaign section, and of results."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from optim.campaign.sampling.parameter_space import campaign_of
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.result.store import SCENARIO
from spacerobot.scenario import Scenario
from spacerobot.scenario.document import read_document
from spacerobot.scenario.load import to_document, validate
from spacerobot.scene import Scene

Gains = Mapping[str, Mapping[str, Any]]
"""Changes by dotted path, by the name of the set of gains."""
NOMINAL = "scenario"
"""Name of the scenario's own gains."""
NAMED = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,63}")  # as the campaign section has them
CONTROL = ("pid", "amnesia", "orientation_pid", "orientation_amnesia")


def gain_sets(scene: Scene, set_names: Sequence[str]) -> Gains | None:
    """Sets of gains that a user selects; None for those of the campaign section.

    Args:
        scene: The scene.
        set_names: ``NAME`` of a set of the section, ``scenario`` for the scenario's gains, or ``NAME=DIR``
            for the gains of a result.

    Raises:
        ScenarioError: If there is no such set, or a result has other robots.
    """
    gains_by_name = {NOMINAL: {}, **campaign_of(scene).gains}
    chosen_gains: dict[str, dict[str, Any]] = {}
    for text in set_names:
        name, equals, folder = text.partition("=")
        if equals and not (NAMED.fullmatch(name) and folder):
            allowed = "NAME=DIR, the name of letters, digits, _ and -, at most 64"
            raise ScenarioError(f"found {text!r}, allowed: {allowed}", where="--gains")
        if equals and name in gains_by_name:
            raise ScenarioError(f"{name!r} names a set of the scenario's already", where="--gains")
        if name in chosen_gains:
            raise ScenarioError(f"{name!r} is given twice", where="--gains")
        if equals:
            chosen_gains[name] = controllers(scene, Path(folder))
        elif name in gains_by_name:
            chosen_gains[name] = dict(gains_by_name[name])
        else:
            hint = f"{near_names(name, gains_by_name)}; or NAME=DIR with the folder of a result"
            raise scene.error(f"no set {name!r}; {hint}", "--gains")
    return chosen_gains or None


def controllers(scene: Scene, folder: Path) -> dict[str, Any]:
    """Controllers of a result, as changes to the scene's scenario by dotted path.

    Raises:
        ScenarioError: If the folder holds no scenario, or its robots have other tips.
    """
    source = folder / SCENARIO
    other = validate(read_document(source), source=source)
    if _tips(other) != _tips(scene.scenario):
        mine = ", ".join(_tips(scene.scenario))
        raise ScenarioError(f"has other tips: {', '.join(_tips(other))}; here: {mine}", source=source)
    changes: dict[str, Any] = {}
    for name, robot in to_document(other)["robots"].items():
        changes[f"robots.{name}.joint_pd"] = robot["joint_pd"]
        for tip, held in robot["tips"].items():
            changes |= {f"robots.{name}.tips.{tip}.{part}": held[part] for part in CONTROL}
    return changes


def _tips(scenario: Scenario) -> list[str]:
    return [f"{name}/{tip}" for name, robot in scenario.robots.items() for tip in robot.tips]
