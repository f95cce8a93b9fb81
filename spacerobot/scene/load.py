"""Scenes from scenario files.

Modules for reading, validating and building are imported one after the other, so that a wrong name or file is
reported at once.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath
from spacerobot.scenario.catalogue import find_scenario
from spacerobot.scenario.document import read_document

if TYPE_CHECKING:
    from spacerobot.scenario.scenario import Scenario
    from spacerobot.scene.scene import Scene


def load_scene(
    name: StrPath,
    changes: Mapping[str, Any] | Sequence[tuple[str, Any]] = (),
    *,
    expand_xacro: bool = True,
) -> Scene:
    """Scene of a scenario file or of a shipped scenario.

    Args:
        name: Path of a YAML file, or the name of a shipped scenario.
        changes: New values by dotted path (``*`` matches every key), applied in order after URDF values have
            been filled in.
        expand_xacro: Whether ``.xacro`` files are expanded; False for files from untrusted sources.

    Raises:
        ScenarioError, DescriptionError: If anything in the scenario or its URDFs cannot be simulated.
    """
    pairs = change_pairs(changes)
    scenario, source = read_scenario(name, pairs)
    from spacerobot.scene.resolve import resolve

    resolved, descriptions = resolve(scenario, pairs, source=source, expand_xacro=expand_xacro)
    from spacerobot.scene.build import assemble

    return replace(assemble(resolved, descriptions, source=source), changes=pairs)


def change_pairs(changes: Mapping[str, Any] | Sequence[tuple[str, Any]]) -> tuple[tuple[str, Any], ...]:
    """Changes of a scenario as pairs of dotted path and value.

    Raises:
        ScenarioError: If they are neither a mapping nor pairs, or a path is no text.
    """
    items = changes.items() if isinstance(changes, Mapping) else changes
    wrong: Any = changes
    try:
        pairs = tuple((path, value) for path, value in items)
        wrong = next((path for path, _ in pairs if not isinstance(path, str)), "")
    except (TypeError, ValueError):  # neither a mapping nor pairs
        pairs = ()
    if wrong != "":
        message = f"found {wrong!r}, allowed: values by path, such as {{'simulation.duration': 20}}"
        raise ScenarioError(message, where="changes")
    return pairs


def read_scenario(name: StrPath, changes: Sequence[tuple[str, Any]] = ()) -> tuple[Scenario, Path]:
    """Scenario of a file or of a shipped scenario, without the values of its URDFs, and the file's path.

    Args:
        name: Path of a YAML file, or the name of a shipped scenario.
        changes: New values by dotted path; they are checked as far as no URDF is needed, and not applied.

    Raises:
        ScenarioError: If the file cannot be read, or the scenario or a change is not valid.
    """
    if not isinstance(name, str | os.PathLike):
        raise ScenarioError(f"found {type(name).__name__}, allowed: its name or its file", where="scenario")
    source = find_scenario(os.fspath(name))
    named = re.sub(r"[^\w-]", "_", source.stem, flags=re.ASCII).lstrip("0123456789-")[:64]
    document = {"name": named or "scenario"} | read_document(source)
    from spacerobot.scenario.load import check_changes, validate

    scenario = validate(document, source=source)
    check_changes(scenario, changes, source=source)
    return scenario, source


def to_scene(scene: Scene | StrPath) -> Scene:
    """Scene itself, or that of a scenario's name or file.

    Args:
        scene: A scene, the path of a YAML file, or the name of a shipped scenario.

    Raises:
        ScenarioError, DescriptionError: As :func:`load_scene`.
    """
    if isinstance(scene, str | os.PathLike):
        return load_scene(scene)
    from spacerobot.scene.scene import Scene

    if not isinstance(scene, Scene):
        allowed = "a scene of `load_scene`, or the name or file of its scenario"
        raise ScenarioError(f"found {type(scene).__name__}, allowed: {allowed}", where="scene")
    return scene
