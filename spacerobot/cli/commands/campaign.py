"""``spacerobot campaign``: Monte Carlo analysis of sets of gains over uncertain parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli import page_data as playing
from spacerobot.cli.campaign_page import campaign_page
from spacerobot.cli.campaign_tables import show
from spacerobot.cli.command import Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import Changes, Machines, Port, ScenarioName, Threads, View, parse_changes
from spacerobot.cli.output import console, progress, warn
from spacerobot.interrupts import keep

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


@Command.of("campaign", place=12)
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
    from optim.campaign import ROLLING_OUT, LocalExecutor, ScenarioSource, run_campaign, summarise
    from optim.campaign.cluster import DaskExecutor
    from optim.campaign.rollouts.gain_sets import gain_sets
    from optim.campaign.sampling.parameter_space import campaign_of
    from spacerobot.errors import ScenarioError
    from spacerobot.files import write_text
    from spacerobot.scene import build_scene, load_scene

    given = parse_changes(changes)
    scene = load_scene(scenario, given)
    section = campaign_of(scene)
    if samples is not None:
        if section.sampler.is_factorial:
            message = f"a grid's samples follow from its levels: here {section.count}; set campaign.levels"
            raise ScenarioError(message, source=scene.source, where="--samples")
        scene = build_scene(scene.scenario, {"campaign.samples": samples}, source=scene.source)
    chosen = gain_sets(scene, gains or [])
    with progress("reading") as tell:

        def report(now: CampaignProgress) -> None:
            """Say what is being done; what is rolled out is kept."""
            keep(now.phase == ROLLING_OUT)
            tell(str(now))

        found = run_campaign(
            scene,
            out,
            gains=chosen,
            executor=LocalExecutor(threads) if dask is None else DaskExecutor(dask),
            progress=report,
            named=ScenarioSource(scenario, given),
        )
        summary = None
        if found.done:
            keep(False)
            tell("computing statistics")
            summary = summarise(out, found.evaluator)
            if page:
                write_text(out / "report.html", campaign_page(out, tell, found.evaluator))
    if summary is not None:
        show(summary)
    console().print(f"{found.done} of {found.total} samples in {out}", markup=False, soft_wrap=True)
    if summary is not None:
        line = (
            f"report in {out / 'report.html'}" if page else f"`spacerobot report {out}` makes a page of them"
        )
        console().print(line, markup=False, soft_wrap=True)
    if found.interrupted:
        warn("interrupted: the same command resumes the campaign")
        raise typer.Exit(130)
    if view:
        with progress("simulating the worst samples") as tell:
            played = playing.campaign(out, tell, found.evaluator)
        serve(played.data, port)
