"""``spacerobot paper``: every variant of the paper, compared with its figures."""

from __future__ import annotations

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.commands.run import warn_if_open
from spacerobot.cli.options import Out
from spacerobot.cli.output import console, progress, show


@Command.of("paper", place=6, group=SIMULATE)
def command(out: Out = None) -> None:
    """Run PID only and PID + amnesia, with both feedback variants and both radii; compare with the paper.

    Example:

        spacerobot paper --out out/paper
    """
    with progress("building the closed loop") as tell:
        compared = sr.reproduce_paper(out, progress=tell)
    show(compared)
    for result in compared.results.values():
        warn_if_open(result)
    if out is not None:
        console().print(f"\nresults in {out}", markup=False, soft_wrap=True)
