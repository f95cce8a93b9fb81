"""``spacerobot robust``: tune gains for uncertain parameters."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.commands.run import warn_if_open
from spacerobot.cli.options import Changes, Machines, Out, ScenarioName, Threads, load, reported_at
from spacerobot.cli.output import print_next, show
from spacerobot.cli.tuning_options import (
    Budget,
    Runs,
    Seed,
    Starts,
    Variables,
    Variant,
    check_names,
    effort_of_ga,
    journals,
    parts,
    shown,
    stop_if_interrupted,
)
from spacerobot.common.registry import TUNING_METHODS

Measure = Annotated[
    Literal["mean", "percentile", "worst"],
    typer.Option(
        "--measure",
        metavar="NAME",
        help="mean, percentile or worst: statistic of the samples' objectives that is minimised.",
    ),
]
Percent = Annotated[
    float,
    typer.Option(
        "--percent", min=1, max=99, metavar="P", help="Percentile that --measure percentile minimises."
    ),
]
Common = Annotated[int, typer.Option("--samples", min=2, metavar="N", help="Samples used in tuning.")]
Fresh = Annotated[int, typer.Option("--fresh", min=2, metavar="N", help="Samples of the verification.")]
Method = Annotated[
    str, typer.Option("--method", metavar="NAME", help=f"{', '.join(TUNING_METHODS.names())}.")
]


@Command.of("robust", place=2, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    measure: Measure = "worst",
    percent: Percent = 95.0,
    samples: Common = 64,
    fresh: Fresh = 512,
    method: Method = "nlp",
    variant: Variant = None,
    variables: Variables = None,
    budget: Budget = None,
    runs: Runs = None,
    starts: Starts = None,
    seed: Seed = None,
    threads: Threads = None,
    dask: Machines = None,
) -> None:
    """Tune gains for the uncertain numbers of the campaign section; verify them on fresh samples.

    Example:

        spacerobot robust paper --variant base --variables seven --measure worst --out out/robust
    """
    with reported_at("--method"):
        TUNING_METHODS.check(method)
    scene = load(scenario, changes, "tuning", "campaign")
    from optim.methods.tuning_method import check_robust_method

    with reported_at("--method"):
        check_robust_method(method)
    check_names(scene, variables, variant)
    folder, effort = journals(out, "robust.json"), effort_of_ga(budget, runs, starts, seed)
    with shown() as (tell, report), sr.open_workers(threads, dask) as workers:
        tell("building the closed loop")
        problem = sr.build_robust(
            scene,
            sr.Statistic(measure, percent, samples),
            variables=parts(variables),
            variant=variant,
            workers=workers,
        )
        tuned = sr.tune_robust(problem, method, effort=effort, fresh=fresh, folder=folder, progress=report)
        if out is not None:
            tell("simulating and saving the robust design")
            result = sr.simulate(tuned.scene).save(out)
            tuned.save(out)
    show(tuned)
    if out is not None:
        warn_if_open(result)
        print_next(f"result and robust.json in {out}; `spacerobot report {out}` makes a page of the result")
    stop_if_interrupted(tuned.outcome)
