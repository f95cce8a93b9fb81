"""Uncertain parameters of a scene: from draws to numbers of the scenario, by dotted path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from optim.problem.scenario_numbers import find_numbers
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario import Campaign
from spacerobot.scenario.document import MISSING_SECTIONS
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.paths import assign
from spacerobot.scenario.units import unit_at
from spacerobot.scene import Scene, build_scene


@dataclass(frozen=True)
class ParameterSpace:
    """Map from draws of k uncertain parameters to m numbers of the scenario.

    Attributes:
        names: Names of the parameters.
        paths: Dotted paths of the numbers, m of them.
        patterns: Pattern in the section that names each number (m,).
        owner: Index of the parameter that sets each number (m,).
        factor, offset: Number = offset + factor times draw, each (m,).
    """

    names: tuple[str, ...]
    paths: tuple[str, ...]
    patterns: tuple[str, ...]
    owner: tuple[int, ...]
    factor: Array
    offset: Array

    def values(self, draws: Array) -> Array:
        """Numbers (N, m) for draws (N, k)."""
        return np.asarray(self.offset + self.factor * np.atleast_2d(draws)[:, list(self.owner)])


def campaign_of(scene: Scene) -> Campaign:
    """The scene's campaign section.

    Raises:
        ScenarioError: If it has none.
    """
    if scene.scenario.campaign is None:
        raise scene.error(MISSING_SECTIONS["campaign"], "campaign")
    return scene.scenario.campaign


def with_samples(scene: Scene, samples: int) -> Scene:
    """The scene with another number of samples in its campaign section.

    Raises:
        ScenarioError: If there is no such section, its sampler is a grid, or it cannot draw this number.
    """
    section = campaign_of(scene)
    if section.sampler.is_factorial:
        message = f"a grid's samples follow from its levels: here {section.count}; set campaign.levels"
        raise scene.error(message, "--samples")
    change = ("campaign.samples", samples)
    changed_scene = build_scene(scene.scenario, [change], source=scene.source)
    return replace(changed_scene, changes=(*scene.changes, change))


def gain_set(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """The scene with one set of gains, and with ideal sensors if the campaign varies sensor errors.

    Raises:
        ScenarioError: If the path of a change does not exist, or the result is no valid scenario.
    """
    changed_scene = build_scene(scene.scenario, changes, source=scene.source) if changes else scene
    patterns = [p for parameter in campaign_of(scene).parameters.values() for p in parameter.paths]
    if not any(".sensors." in pattern for pattern in patterns):
        return changed_scene
    robots = changed_scene.scenario.robots
    ideal: dict[str, Any] = {f"robots.{n}.sensors": {} for n, r in robots.items() if r.sensors is None}
    return build_scene(changed_scene.scenario, ideal, source=scene.source) if ideal else changed_scene


def resolve_space(scene: Scene, campaign: Campaign) -> ParameterSpace:
    """Resolve the parameters of a campaign to the scene's numbers.

    Raises:
        ScenarioError: If a path is not in the scenario, is no number, or belongs to two parameters.
    """
    named = {name: parameter.paths for name, parameter in campaign.parameters.items()}
    numbers_by_name = find_numbers(scene, named, "campaign.parameters")
    owners = [index for index, name in enumerate(named) for _ in numbers_by_name[name]]
    numbers = [number for name in named for number in numbers_by_name[name]]
    applied = [list(campaign.parameters.values())[index].apply for index in owners]
    pairs = list(zip(numbers, applied, strict=True))
    return ParameterSpace(
        tuple(named),
        tuple(number.path for number in numbers),
        tuple(number.pattern for number in numbers),
        tuple(owners),
        np.array([number.value if apply == "factor" else 1.0 for number, apply in pairs]),
        np.array([number.value if apply == "offset" else 0.0 for number, apply in pairs]),
    )


def units_of(scene: Scene, campaign: Campaign, space: ParameterSpace) -> dict[str, str]:
    """Unit of each parameter's draw; for factors and offsets also the way in which they are applied."""
    units = {}
    for index, (name, parameter) in enumerate(campaign.parameters.items()):
        unit = unit_at(scene.scenario, space.paths[space.owner.index(index)])
        added = f"{unit}, added to the scenario's"
        units[name] = {"value": unit, "factor": "times the scenario's", "offset": added}[parameter.apply]
    return units


def sensor_offsets(campaign: Campaign) -> list[str]:
    """Parameters that are a sensor's offset."""
    return [
        name
        for name, parameter in campaign.parameters.items()
        if any(".sensors." in path and path.endswith(".offset") for path in parameter.paths)
    ]


def check_range(scene: Scene, space: ParameterSpace, draws: Array) -> None:
    """Refuse draws that no scenario may hold, such as a negative mass.

    Args:
        scene, space: The scene and where the draws go.
        draws: Draws of all samples (N, k); their smallest and their largest values are checked.

    Raises:
        ScenarioError: If a value is not allowed; the message names the number.
    """
    values = space.values(draws)
    plain = to_document(scene.scenario)
    for extreme in (values.min(axis=0), values.max(axis=0)):
        document = plain
        for path, value in zip(space.paths, extreme, strict=True):
            document = assign(document, path, float(value))
        try:
            validate(document)
        except ScenarioError as fault:
            hint = "cut the distribution (truncated_normal, uniform) or take another (lognormal)"
            message = f"the campaign draws a value that is not allowed: {fault.message}; {hint}"
            raise scene.error(message, fault.where) from None
