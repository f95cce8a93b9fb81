"""A command of the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import typer


@dataclass(frozen=True)
class Command:
    """A command, or a group of commands.

    Attributes
    ----------
    name
        Behind ``spacerobot``.
    join
        Adds it to an application.
    place
        Its place in the help.
    """

    name: str
    join: Callable[[typer.Typer], Any]
    place: float = 100.0

    @classmethod
    def of(cls, name: str, function: Callable[..., Any], help: str, place: float = 100.0) -> Command:
        """A command that is one function.

        Parameters
        ----------
        name
            Behind ``spacerobot``.
        function
            What it does; its parameters are arguments and options, as Typer reads them.
        help
            Paragraphs; an indented one is an example.
        place
            Its place in the help.
        """
        return cls(name, lambda app: app.command(name, help=help)(function), place)
