"""``spacerobot kinds``: elements available to scenarios."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, table

if TYPE_CHECKING:
    from spacerobot.section import Section

HEADINGS = ("family", "kind", "description")
KEYS = ("key", "default", "description")


@Command.of("kinds", place=15)
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
    """
    from spacerobot.elements.core import kind_table
    from spacerobot.errors import SpaceRobotError, near_names

    if markdown:
        typer.echo(kind_table.markdown())
        return
    families = _families()
    if name is None:
        rows = [(_words(family), *row) for family, kinds in families.items() for row in _summaries(kinds)]
        console().print(table(None, HEADINGS, rows))
        return
    family = name.replace(" ", "_").replace("-", "_")
    if kind is not None and family not in families:
        raise SpaceRobotError(f"no family {name!r}; {near_names(family, families)}")
    if kind is None and family in families:
        console().print(table(_words(family), HEADINGS[1:], _summaries(families[family])))
        return
    wanted = name if kind is None else kind
    chosen = families if kind is None else {family: families[family]}
    homes = [each for each, kinds in chosen.items() if wanted in kinds]
    if not homes:
        if kind is not None:
            raise SpaceRobotError(
                f"no kind of {_words(family)} {kind!r}; {near_names(kind, families[family])}"
            )
        near = get_close_matches(name, {*families, *(each for kinds in families.values() for each in kinds)})
        help_text = near_names(name, near) if near else f"families: {', '.join(families)}"
        raise SpaceRobotError(f"no family or kind {name!r}; {help_text}")
    for each in homes:
        console().print(
            table(f"{_words(each)} {wanted}", KEYS, kind_table.fields_of(chosen[each][wanted][0]))
        )


def _words(family: str) -> str:
    return family.replace("_", " ")


def _summaries(kinds: dict[str, tuple[type[Section], str]]) -> list[tuple[str, str]]:
    return [(name, summary) for name, (_, summary) in kinds.items()]


def _families() -> dict[str, dict[str, tuple[type[Section], str]]]:
    """Section and description of each kind, by family and name."""
    from spacerobot.elements import FAMILIES, PLANS, kinds
    from spacerobot.elements.core.kind_table import summary_of
    from spacerobot.quantities import planned
    from spacerobot.scenario.plan_cost import PlanCost

    families: dict[str, dict[str, tuple[type[Section], str]]] = {
        family: {name: (section, summary_of(section)) for name, section in kinds(family).items()}
        for family in FAMILIES | PLANS
    }
    costs: dict[str, tuple[type[Section], str]] = {
        name: (PlanCost, cost.description) for name, cost in planned().items()
    }
    return families | {"plan_cost": costs}
