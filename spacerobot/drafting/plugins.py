"""Drafts of plugins and their tests, from the shipped examples with the names of the user's files."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from pathlib import Path

from spacerobot.common.errors import ScenarioError, SpaceRobotError, near_names
from spacerobot.common.files import StrPath, write_text
from spacerobot.drafting.request import check_absence

TEMPLATES = {
    "sensor": "thermal",
    "actuator": "reaction_wheel",
    "controller": "bounded_spring",
    "reference": "lemniscate",
    "shape": "ellipsoid",
    "quantity": "tip_speed",
    "goal": "pointing",
}
"""Example that is the template of each family."""


@dataclass(frozen=True)
class PluginDraft:
    """A plugin and its test.

    Attributes:
        file: File of the plugin.
        test: File of its test, for pytest.
        command: Command that uses the plugin.
    """

    file: Path
    test: Path
    command: str


def draft_plugin(family: str, file: StrPath) -> PluginDraft:
    """Write a working plugin as a template, and its test.

    Args:
        family: Family of its kind: a sensor, actuator, controller, reference, shape, quantity or goal.
        file: Python file to write; the test is ``test_FILE`` in its folder. Neither may exist.

    Returns:
        PluginDraft: Files of plugin and test, and the command that uses the plugin.

    Raises:
        ScenarioError: If the file is no Python file, or one of the files exists.
        SpaceRobotError: If there is no template of the family.
    """
    file = Path(file)
    if file.suffix != ".py":
        raise ScenarioError(f"found {str(file)!r}, allowed: a Python file, {file.stem}.py", where="--out")
    text, test = plugin_template(family, file), plugin_test_file(file)
    for each in (file, test):
        check_absence(each)
    write_text(file, text)
    write_text(test, plugin_test(family, file))
    return PluginDraft(file, test, plugin_command(text))


def plugin_template(family: str, file: Path) -> str:
    """Text of a plugin, whose first lines contain the command that uses it.

    Args:
        family: A key of :data:`TEMPLATES`.
        file: File of the plugin, named in the command.

    Raises:
        SpaceRobotError: If the family has no template, or the examples are missing.
    """
    example = f"{_example(family)}.py"
    return _text(example).replace(f"--plugin {example}", f"--plugin {shlex.quote(str(file))}")


def plugin_test(family: str, file: Path) -> str:
    """Text of a plugin's test, which runs from any folder.

    Args:
        family: A key of :data:`TEMPLATES`.
        file: File of the plugin; the test is in the same folder.

    Raises:
        SpaceRobotError: As :func:`plugin_template`.
    """
    example = _example(family)
    return _text(f"test_{example}.py").replace(f'"{example}.py"', json.dumps(file.name))


def plugin_test_file(file: Path) -> Path:
    """File of a plugin's test."""
    return file.with_name(f"test_{file.name}")


def _example(family: str) -> str:
    if family not in TEMPLATES:
        raise SpaceRobotError(f"family {family!r}, {near_names(family, TEMPLATES)}", where="--plugin")
    return TEMPLATES[family]


def _text(name: str) -> str:
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_plugins", package.parent / "examples" / "plugins"):  # wheel, checkout
        if (folder / name).is_file():
            return (folder / name).read_text(encoding="utf-8")
    raise SpaceRobotError("the templates are missing; install spacerobot again", source=package)


def plugin_command(text: str) -> str:
    """Command in the first lines of a plugin's text, joined to one line."""
    command = text.split("\n\n")[1].partition('"""')[0]
    return " ".join(command.replace("\\\n", " ").split())
