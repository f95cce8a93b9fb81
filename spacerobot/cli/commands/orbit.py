"""``spacerobot orbit``: initial states of a rendezvous from two-line elements or ephemerides."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import EXCHANGE, Command


@Command.of("orbit", place=2, group=EXCHANGE)
def command(
    chaser: Annotated[Path, typer.Argument(help="Two-line elements or OEM of the chaser.")],
    target: Annotated[Path, typer.Argument(help="Two-line elements or OEM of the target.")],
    at: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="TIME", help="Epoch (ISO 8601); by default the later one of both files."
        ),
    ] = None,
) -> None:
    """Print reference orbit and relative state, as sections of a scenario.

    Examples:

        spacerobot orbit chaser.tle target.tle --at 2026-11-23T12:00:00
    """
    typer.echo(sr.rendezvous_start(chaser, target, at).to_yaml(), nl=False)
