"""``spacerobot scenarios``: shipped scenarios and URDFs."""

from __future__ import annotations

import spacerobot as sr
from spacerobot.cli.command import BEGIN, Command
from spacerobot.cli.output import show


@Command.of("scenarios", place=3, group=BEGIN)
def command() -> None:
    """List the shipped scenarios and URDFs.

    Example:

        spacerobot scenarios
    """
    from spacerobot.scenario.catalogue import shipped

    listed = sr.list_scenarios()
    folder = shipped()["docking"].parent
    following = f"`spacerobot run NAME` simulates one; to change one, copy its file from {folder}"
    show([*listed.content(), following])
