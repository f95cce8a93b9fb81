"""A command of the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import typer

from spacerobot.common.registry import COMMANDS

Function = TypeVar("Function", bound=Callable[..., Any])

BEGIN, SIMULATE, LOOK = "Begin and list", "Simulate and analyse", "Look at results"
PLAN, TUNE, EXCHANGE, PLUGIN = "Plan", "Tune and campaign", "Exchange", "Plugins"
GROUPS = (SIMULATE, LOOK, PLAN, TUNE, BEGIN, EXCHANGE, PLUGIN)
"""Groups of the help, in its order."""


@dataclass(frozen=True)
class Command:
    """A command, or a group of commands.

    Attributes:
        name: Behind ``spacerobot``.
        join: Adds it to an application.
        place: Its place in the help, within its group.
        group: Group of the help, one of :data:`GROUPS`.
    """

    name: str
    join: Callable[[typer.Typer], Any]
    place: float = 100.0
    group: str = PLUGIN

    @classmethod
    def of(cls, name: str, place: float = 100.0, group: str = PLUGIN) -> Callable[[Function], Function]:
        """Decorator that registers a function as a command.

        Its parameters are arguments and options, as Typer reads them; its docstring is the help: paragraphs,
        of which an indented one is an example.

        Args:
            name: Behind ``spacerobot``.
            place: Its place in the help, within its group.
            group: Group of the help, one of :data:`GROUPS`.
        """

        def join(function: Function, app: typer.Typer) -> Any:
            """Add it under the heading of its group."""
            return app.command(name, rich_help_panel=group)(function)

        def add(function: Function) -> Function:
            """Register it under its module."""
            COMMANDS.add(cls(name, partial(join, function), place, group), function.__module__)
            return function

        return add
