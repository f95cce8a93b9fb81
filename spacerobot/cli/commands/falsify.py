"""``spacerobot falsify``: the worst outcome that uncertain parameters allow."""

from __future__ import annotations

from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.options import Changes, Out, ScenarioName, Threads, existing_quantity, load
from spacerobot.cli.output import print_next, show
from spacerobot.cli.tuning_options import Seed, journals, shown

Metric = Annotated[
    str | None,
    typer.Option(
        "--metric",
        metavar="NAME",
        callback=existing_quantity,
        help="Quantity; the one that `campaign.limits` bounds if not given.",
    ),
]
Limit = Annotated[
    float | None,
    typer.Option(
        "--limit",
        metavar="VALUE",
        help="A larger value of the metric is a failure; that of `campaign.limits` if not given.",
    ),
]


@Command.of("falsify", place=5, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    metric: Metric = None,
    limit: Limit = None,
    starts: Annotated[
        int, typer.Option("--starts", min=1, metavar="N", help="Maximum number of descents.")
    ] = 16,
    budget: Annotated[
        int | None,
        typer.Option(
            "--budget", min=1, metavar="N", help="Maximum number of rollouts; a gradient counts as four."
        ),
    ] = None,
    seed: Seed = None,
    threads: Threads = None,
) -> None:
    """Search the uncertain parameters of the campaign section for the worst value of a metric.

    Descents from many starts by exact gradients (by differences with fewer than four parameters),
    compared with random search at equal cost. With --out, the worst case is simulated and saved as a
    result.

    Examples:

        spacerobot falsify paper --metric tip_error_peak --out out/worst

        spacerobot falsify paper --metric grip_force_peak --limit 25 --starts 32
    """
    scene = load(scenario, changes, "campaign")
    from optim.reliability.bounded_quantity import bounded_quantity

    bounded_quantity(scene, metric, limit)  # refused before the libraries of the search are loaded
    folder = journals(out, "falsify.json")
    with shown() as (tell, report):
        tell("building the closed loop")
        worst = sr.falsify(
            scene,
            metric,
            limit,
            effort={"budget": budget, "starts": starts, "seed": seed},
            folder=folder,
            progress=report,
            threads=threads,
        )
        if out is not None:
            tell("simulating and saving the worst case")
            sr.simulate(worst.scene(scene)).save(out)
            worst.save(out / "falsify.json")
    show(worst)
    if out is not None:
        print_next(
            f"worst case in {out}; `spacerobot report {out}` makes a page of its simulation; "
            f"`spacerobot report {out / 'falsify.json'}` makes a page of the search"
        )
    else:
        print_next("not saved; `--out DIR` saves the worst case and its simulation")
