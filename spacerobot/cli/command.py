"""A command of the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import typer

from spacerobot.registry import COMMANDS

Function = TypeVar("Function", bound=Callable[..., Any])


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
    def of(cls, name: str, place: float = 100.0) -> Callable[[Function], Function]:
        """Decorator that registers a function as a command.

        Its parameters are arguments and options, as Typer reads them; its docstring is the help: paragraphs,
        of which an indented one is an example.

        Parameters
        ----------
        name
            Behind ``spacerobot``.
        place
            Its place in the help.
        """

        def add(function: Function) -> Function:
            """Register it under its module."""
            COMMANDS.add(cls(name, lambda app: app.command(name)(function), place), function.__module__)
            return function

        return add
