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
    show(sr.list_scenarios())
