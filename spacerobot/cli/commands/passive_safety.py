"""``spacerobot passive-safety``: whether bodies stay apart after an abort at any instant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.output import progress, show
from spacerobot.cli.plugins import check_folders, load_plugins_of
from spacerobot.common.tables import Table


@Command.of("passive-safety", place=5, group=SIMULATE)
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")],
    drift: Annotated[
        float, typer.Option("--drift", metavar="SECONDS", help="Duration of the drift [s].")
    ] = 600.0,
    clearance: Annotated[
        float | None, typer.Option("--clearance", metavar="METRES", help="Distance that must be kept [m].")
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            "--until",
            metavar="SECONDS",
            help="Time of the last abort [s]; by default the first capture, or the end.",
        ),
    ] = None,
) -> None:
    """Find the smallest distance of robots and target in free drift after an abort at any sample.

    Actuators are off and joints are braked from the abort on. Exits with 1 if a clearance is not kept.

    Examples:

        spacerobot passive-safety out/docking --drift 600 --clearance 0.5
    """
    check_folders([result])
    load_plugins_of([result])
    loaded = sr.Result.load(result)
    with progress("drifting") as tell:
        safety = sr.passive_safety(loaded, duration_s=drift, until_s=until, progress=tell)
    show([Table.of_pairs(loaded.scenario.name, safety.rows(clearance))])
    if clearance is not None and len(safety.unsafe(clearance)):
        raise typer.Exit(1)
