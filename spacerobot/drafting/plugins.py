"""Templates of plugins: the examples, written with the file's own name in the command that uses them."""

from __future__ import annotations

import shlex
from pathlib import Path

from spacerobot.errors import SpaceRobotError, near_names

TEMPLATES = {
    "sensor": "thermal",
    "actuator": "reaction_wheel",
    "controller": "impedance",
    "reference": "lemniscate",
    "shape": "ellipsoid",
    "quantity": "tip_speed",
    "goal": "pointing",
}
"""Example of each family, by name."""


def plugin_template(family: str, file: Path) -> str:
    """Text of a plugin, with the command that uses it in its first lines.

    Parameters
    ----------
    family
        A key of :data:`TEMPLATES`.
    file
        File that it is written to; the command names it.

    Raises
    ------
    SpaceRobotError
        If there is no template of that family, or the examples are missing.
    """
    if family not in TEMPLATES:
        raise SpaceRobotError(f"family {family!r}, {near_names(family, TEMPLATES)}", where="--plugin")
    package = Path(__file__).resolve().parents[1]
    example = f"{TEMPLATES[family]}.py"
    for folder in (package / "_plugins", package.parent / "examples" / "plugins"):  # wheel, checkout
        if (folder / example).is_file():
            text = (folder / example).read_text(encoding="utf-8")
            return text.replace(f"--plugin {example}", f"--plugin {shlex.quote(str(file))}")
    raise SpaceRobotError("the templates are missing; install spacerobot again", source=package)


def plugin_command(text: str) -> str:
    """Command that uses a plugin, from the text of the plugin, on one line."""
    command = text.split("\n\n")[1].partition('"""')[0]
    return " ".join(command.replace("\\\n", " ").split())
