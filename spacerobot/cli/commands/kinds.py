"""``spacerobot kinds``: elements available to scenarios."""

from __future__ import annotations

from typing import Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, table


@Command.of("kinds", place=15)
def command(
    kind: Annotated[str | None, typer.Argument(help="A kind whose keys to list.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="As a table for documentation.")] = False,
) -> None:
    """List the kinds of references, grasps, controllers, actuators, goals, ..., or the keys of one kind.

    Example:

        spacerobot kinds

        spacerobot kinds circle
    """
    from spacerobot.elements import FAMILIES, PLANS, kinds
    from spacerobot.elements.core import kind_table as tables
    from spacerobot.errors import SpaceRobotError, near_names
    from spacerobot.quantities import planned
    from spacerobot.scenario.plan_cost import PlanCost
    from spacerobot.section import Section

    if markdown:
        typer.echo(tables.markdown())
        return
    every: list[tuple[str, str, type[Section]]] = [
        (family, name, found) for family in FAMILIES | PLANS for name, found in kinds(family).items()
    ]
    rows = [(family.replace("_", " "), name, tables.summary_of(found)) for family, name, found in every]
    rows += [("plan cost", name, weighed.description) for name, weighed in planned().items()]
    every += [("plan_cost", name, PlanCost) for name in planned()]
    title = ("family", "kind", "description")
    if kind is not None:
        chosen = [found for _, name, found in every if name == kind]
        if not chosen:
            raise SpaceRobotError(f"no kind {kind!r}; {near_names(kind, [name for _, name, _ in every])}")
        rows, title = (
            [row for found in chosen for row in tables.fields_of(found)],
            ("key", "default", "description"),
        )
    console().print(table(kind, title, rows))
