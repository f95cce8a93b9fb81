"""``spacerobot identify``: mass properties of a held object."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, progress, table
from spacerobot.cli.plugins import load_plugins_of


@Command.of("identify", place=6)
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")],
    since: Annotated[
        float | None,
        typer.Option("--since", help="Time from which to use samples [s]; else the last capture."),
    ] = None,
    noise: Annotated[
        float,
        typer.Option(
            "--noise",
            min=0,
            help="Noise of the sensors, as a multiple of that of usual star trackers, gyros and encoders.",
        ),
    ] = 1.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the noise.")] = 0,
) -> None:
    """Identify mass, centre of mass and inertia of a held object from the momentum of a simulated motion.

    Examples:

        spacerobot identify out/servicer

        spacerobot identify out/servicer --noise 1 --since 5
    """
    load_plugins_of([result])
    from optim.identification import SensorNoise, identify
    from spacerobot.result import Result

    with progress("identifying"):
        found = identify(
            Result.load(result), since=since, noise=SensorNoise().scaled(noise) if noise else None, seed=seed
        )
    title = ("", "estimate", "std. deviation", "simulated", "error")
    console().print(table(f"{found.body}, {found.samples} samples", title, found.rows()))
    if found.is_projected:
        console().print(
            "the estimate was no body's and was moved to the nearest that is: more motion is needed"
        )
