"""``spacerobot kinds``: elements available to scenarios."""

from __future__ import annotations

from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import BEGIN, Command
from spacerobot.cli.output import print_next, show


@Command.of("kinds", place=4, group=BEGIN)
def command(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[FAMILY|KIND]", help="A family whose kinds, or a kind whose keys, to list."),
    ] = None,
    kind: Annotated[
        str | None, typer.Argument(metavar="[KIND]", help="A kind of the family that is named before it.")
    ] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="As a table for documentation.")] = False,
) -> None:
    """List the kinds of references, grasps, controllers, actuators, goals, ..., or the keys of one kind.

    Examples:

        spacerobot kinds

        spacerobot kinds actuator

        spacerobot kinds circle

        spacerobot kinds actuator base_wrench

        spacerobot kinds quantity
    """
    if markdown:
        from spacerobot.elements.core import kind_table

        typer.echo(kind_table.markdown())
        return
    listed = sr.list_kinds(name, kind)
    show(listed)
    if not listed.keys:
        hint = "" if name else "; `spacerobot kinds quantity` lists the quantities"
        print_next(f"`spacerobot kinds KIND` lists the keys of a kind{hint}")
