"""Uncertain parameters of a scene: from draws to numbers of the scenario, by dotted path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.protocol import Array
from spacerobot.errors import ScenarioError
from spacerobot.scenario import Campaign
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.paths import assign, expand, get
from spacerobot.scene import Scene, build_scene


@dataclass(frozen=True)
class Space:
    """Where the draws of k uncertain parameters go: m numbers of the scenario.

    Attributes
    ----------
    names
        Names of the parameters.
    paths
        Dotted paths of the numbers, m of them.
    patterns
        What each number was named by in the section (m,).
    owner
        Which parameter each number follows (m,).
    factor, offset
        Number = offset + factor times draw, each (m,).
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

    Raises
    ------
    ScenarioError
        If it has none.
    """
    if scene.scenario.campaign is None:
        raise ScenarioError("this scenario has no campaign section", source=scene.source, where="campaign")
    return scene.scenario.campaign


def gain_set(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """The scene with one set of gains, and with sensors where a campaign makes their errors uncertain.

    Raises
    ------
    ScenarioError
        If a change leads nowhere or gives no valid scenario.
    """
    made = build_scene(scene.scenario, changes, source=scene.source) if changes else scene
    patterns = [p for parameter in campaign_of(scene).parameters.values() for p in parameter.paths]
    if not any(".sensors." in pattern for pattern in patterns):
        return made
    robots = made.scenario.robots
    ideal: dict[str, Any] = {f"robots.{n}.sensors": {} for n, r in robots.items() if r.sensors is None}
    return build_scene(made.scenario, ideal, source=scene.source) if ideal else made


def resolve_space(scene: Scene, campaign: Campaign) -> Space:
    """Where a campaign's draws go in a scene.

    Raises
    ------
    ScenarioError
        If a path is not in the scenario, is no number, or stands in two parameters.
    """
    document = to_document(scene.scenario)
    taken: dict[str, str] = {}
    patterns, owner, factor, offset = [], [], [], []
    for index, (name, parameter) in enumerate(campaign.parameters.items()):
        where = f"campaign.parameters.{name}.paths"
        for pattern in parameter.paths:
            for path in _expand(document, pattern, where, scene):
                nominal = _number(document, path, where, scene)
                if path in taken:
                    found = f"{path} is set by {taken[path]} already"
                    raise ScenarioError(found, source=scene.source, where=where)
                taken[path] = name
                patterns.append(pattern)
                owner.append(index)
                factor.append(nominal if parameter.apply == "factor" else 1.0)
                offset.append(nominal if parameter.apply == "offset" else 0.0)
    return Space(
        tuple(campaign.parameters),
        tuple(taken),
        tuple(patterns),
        tuple(owner),
        np.array(factor),
        np.array(offset),
    )


def check_range(scene: Scene, space: Space, draws: Array) -> None:
    """Refuse draws that no scenario may hold, a negative mass for one.

    Parameters
    ----------
    scene, space
        The scene and where the draws go.
    draws
        All of them (N, k); their least and their greatest values are tried.

    Raises
    ------
    ScenarioError
        With the number that is not allowed.
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
            raise ScenarioError(message, source=scene.source, where=fault.where) from None


def _expand(document: Mapping[str, Any], pattern: str, where: str, scene: Scene) -> list[str]:
    try:
        return expand(document, pattern)
    except ScenarioError as fault:
        raise ScenarioError(f"{pattern}: {fault.message}", source=scene.source, where=where) from None


def _number(document: Mapping[str, Any], path: str, where: str, scene: Scene) -> float:
    value = get(document, path)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"{path} is no number, found {value!r}", source=scene.source, where=where)
    return float(value)
