"""``spacerobot campaign``: Monte Carlo analysis of sets of gains over uncertain parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import Changes, Machines, Port, ScenarioName, Threads, View, load
from spacerobot.cli.output import console, is_narrow, progress, show, warn
from spacerobot.common.interrupts import keep

if TYPE_CHECKING:
    from optim.campaign.run import CampaignProgress

Folder = Annotated[
    Path,
    typer.Option("--out", metavar="DIR", help="Folder of the campaign; an existing campaign is resumed."),
]
Gains = Annotated[
    list[str] | None,
    typer.Option(
        "--gains",
        metavar="NAME[=DIR]",
        help="A set of gains: one of the scenario's campaign section, `scenario` for the scenario's own, or "
        "NAME=DIR for those of a result (spacerobot run, tune). Repeatable.",
    ),
]
Samples = Annotated[
    int | None,
    typer.Option(
        "--samples",
        min=1,
        metavar="N",
        help="Number of samples, each simulated once for every set of gains; that of a grid follows from "
        "its levels.",
    ),
]
Page = Annotated[
    bool, typer.Option("--report", help="Also write DIR/report.html, as `spacerobot report DIR` does.")
]


@Command.of("campaign", place=3, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Folder,
    changes: Changes = None,
    gains: Gains = None,
    samples: Samples = None,
    threads: Threads = None,
    dask: Machines = None,
    page: Page = False,
    view: View = False,
    port: Port = 7000,
) -> None:
    """Monte Carlo robustness analysis: percentiles, probability of failure, sensitivities.

    The scenario's `campaign` section (docs/how_to/monte_carlo.md) defines uncertain parameters, limits,
    sets of gains and signals to keep over time; the shipped `paper` has one. Interrupted campaigns
    resume: repeat the same command. Ctrl-C keeps what is there, and `spacerobot report DIR` makes a page
    of it, finished or not.

    Examples:

        spacerobot campaign paper --out out/campaign --samples 10000

        spacerobot campaign paper --out out/campaign --samples 100000 --dask tcp://scheduler:8786

        spacerobot campaign paper --out out/both --gains scenario --gains tuned=out/tuned
    """
    scene = load(scenario, changes, "campaign")
    from optim.campaign.rollouts.gain_sets import gain_sets

    sets = None if gains is None else gain_sets(scene, gains)  # wrong ones are refused at once
    from optim.campaign import ROLLING_OUT

    with progress("reading") as tell:

        def report(now: CampaignProgress) -> None:
            """Show the progress, and let Ctrl-C keep the finished samples."""
            keep(now.phase == ROLLING_OUT)
            tell(str(now))

        result = sr.campaign(
            scene, out, gains=sets, samples=samples, progress=report, threads=threads, dask=dask
        )
        keep(False)
        tell("computing statistics")
        summary = result.summary if result.done else None
        if summary is not None and page:
            sr.report(result, out / "report.html", progress=tell)
    if summary is not None:
        from optim.campaign.analysis.tables import campaign_content

        for notice in result.notices():
            warn(notice)
        show(campaign_content(summary, narrow=is_narrow()))
        console().print()
        for statistics in summary["gains"].values():  # commands are copied as one line
            console().print(f"reproduce: {statistics['worst'][0]['command']}\n", markup=False, soft_wrap=True)
    console().print(f"{result.done} of {result.total} samples in {out}", markup=False, soft_wrap=True)
    if summary is not None:
        report_file = out / "report.html"
        line = f"report in {report_file}" if page else f"`spacerobot report {out}` makes a page of them"
        console().print(line, markup=False, soft_wrap=True)
    if not result.is_complete:
        warn("interrupted: the same command resumes the campaign")
        raise typer.Exit(130)
    if view:
        serve([out], port)
