"""Commands of the command line and their registration."""

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
        name: Name after ``spacerobot``.
        join: Function that adds the command to an application.
        place: Position in the help, within the group.
        group: Group of the help, one of :data:`GROUPS`.
    """

    name: str
    join: Callable[[typer.Typer], Any]
    place: float = 100.0
    group: str = PLUGIN

    @classmethod
    def of(cls, name: str, place: float = 100.0, group: str = PLUGIN) -> Callable[[Function], Function]:
        """Decorator that registers a function as a command.

        Typer derives arguments and options from the function's parameters. The docstring is the help;
        indented paragraphs are examples.

        Args:
            name: Name after ``spacerobot``.
            place: Position in the help, within the group.
            group: Group of the help, one of :data:`GROUPS`.
        """

        def join(function: Function, app: typer.Typer) -> Any:
            """Add the command under the heading of its group."""
            return app.command(name, rich_help_panel=group)(function)

        def add(function: Function) -> Function:
            """Register the function as a command of its module."""
            COMMANDS.add(cls(name, partial(join, function), place, group), function.__module__)
            return function

        return add
