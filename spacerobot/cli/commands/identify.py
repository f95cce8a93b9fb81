"""``spacerobot identify``: mass properties of a held object."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.output import print_next, progress, show
from spacerobot.cli.plugins import check_folders, load_plugins_of
from spacerobot.common.errors import ResultError


@Command.of("identify", place=4, group=SIMULATE)
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")],
    since: Annotated[
        float | None,
        typer.Option(
            "--since",
            metavar="SECONDS",
            help="Time of the first sample to use [s]; the last capture by default.",
        ),
    ] = None,
    noise: Annotated[
        float,
        typer.Option(
            "--noise",
            metavar="FACTOR",
            min=0,
            help="Noise of the sensors, as a multiple of that of usual star trackers, gyros and encoders.",
        ),
    ] = 1.0,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of the noise.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write, .json, for `spacerobot report FILE`."),
    ] = None,
) -> None:
    """Identify mass, centre of mass and inertia of a held object from the momentum of a simulated motion.

    Examples:

        spacerobot identify out/caught

        spacerobot identify out/caught --noise 1 --since 20

        spacerobot identify out/caught --out out/identified.json
    """
    if out is not None and out.suffix != ".json":
        raise ResultError(f"found {out}, allowed: a file .json", where="--out")
    check_folders([result])
    load_plugins_of([result])
    with progress("identifying"):
        sensors = sr.SensorNoise().scaled(noise) if noise else None
        identified = sr.identify(sr.Result.load(result), since=since, noise=sensors, seed=seed)
    show(identified)
    if out is not None:
        identified.save(out)
        print_next(f"identification in {out}; `spacerobot report {out}` makes a page of it")
