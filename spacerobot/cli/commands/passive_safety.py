"""``spacerobot passive-safety``: whether bodies stay apart after an abort at any instant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, pairs, progress
from spacerobot.cli.plugins import load_plugins_of


@Command.of("passive-safety", place=6)
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")],
    drift: Annotated[float, typer.Option("--drift", help="Length of the drift [s].")] = 600.0,
    clearance: Annotated[
        float | None, typer.Option("--clearance", help="Distance that must be kept [m].")
    ] = None,
    until: Annotated[
        float | None,
        typer.Option("--until", help="Last abort [s]; the first capture, else the end, if not given."),
    ] = None,
) -> None:
    """Find the least distance of robots and target in free drift after an abort at any sample.

    Actuators are off and joints are braked from the abort on. Exits with 1 if a clearance is not kept.

    Examples:

        spacerobot passive-safety out/docking --drift 600 --clearance 0.5
    """
    load_plugins_of([result])
    from spacerobot.abort_drift import passive_safety
    from spacerobot.result import Result

    loaded = Result.load(result)
    with progress("drifting") as tell:
        found = passive_safety(loaded, duration_s=drift, until_s=until, progress=tell)
    unsafe = [] if clearance is None else found.unsafe(clearance).tolist()
    k = found.worst
    rows = [
        ("aborts", f"{len(found.time_s)}, {found.time_s[0]:g} s to {found.time_s[-1]:g} s"),
        ("least distance", f"{found.distance_m[k]:.4g} m: {' and '.join(found.pairs[k])}"),
        ("abort at", f"{found.time_s[k]:g} s, least {found.drift_s[k]:.4g} s later"),
    ]
    if clearance is not None:
        told = f"{len(unsafe)} aborts, the first at {unsafe[0]:g} s" if len(unsafe) else "none"
        rows.append((f"nearer than {clearance:g} m", told))
    console().print(pairs(loaded.scenario.name, rows))
    if len(unsafe):
        raise typer.Exit(1)
