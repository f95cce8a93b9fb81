"""``spacerobot tune``: tune a scenario."""

from __future__ import annotations

from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.commands.run import fail_if_diverged
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
from spacerobot.common.tables import Table

Method = Annotated[
    str,
    typer.Option("--method", metavar="NAME", help=f"{', '.join(TUNING_METHODS.names())}."),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        metavar="PATH=LOW..HIGH",
        help="Tune this number instead of the tuning section's; a path's end (kp, pid.kp) matches all "
        "that end so. Repeatable.",
    ),
]


@Command.of("tune", place=1, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    method: Method = "nlp",
    vary: Vary = None,
    variant: Variant = None,
    variables: Variables = None,
    budget: Budget = None,
    runs: Runs = None,
    starts: Starts = None,
    seed: Seed = None,
    threads: Threads = None,
    dask: Machines = None,
) -> None:
    """Tune a scenario's gains and simulate it with the best ones.

    Interrupted runs resume: repeat the same command with the same --out. Ctrl-C keeps the best so far.

    Examples:

        spacerobot tune paper --variant base --variables five --method nlp --out out/tuned

        spacerobot tune servicer --vary pid.kp=100..4000 --vary pid.ki=50..2000

        spacerobot tune my.yaml --method ga --budget 2000 --runs 3 --dask local:4
    """
    with reported_at("--method"):
        TUNING_METHODS.check(method)
    scene = load(scenario, changes, *(() if vary else ("tuning",)))
    scene = sr.vary(scene, vary) if vary else scene
    check_names(scene, variables, variant)
    folder, effort = journals(out, "tuning.json"), effort_of_ga(budget, runs, starts, seed)
    with shown() as (tell, report), sr.open_workers(threads, dask) as workers:
        tell("building the closed loop")
        problem = sr.build_problem(scene, variables=parts(variables), variant=variant, workers=workers)
        tuned = sr.tune(problem, method, effort=effort, folder=folder, progress=report)
        tell("simulating the best design")
        result = sr.simulate(tuned.scene)
        if out is not None:
            result = result.save(out)
            tuned.save(out)
    show(tuned)
    show([Table.of_pairs("the best design", result.headline())])
    if out is not None:
        print_next(f"\nresult and tuning.json in {out}; `spacerobot report {out}` makes a page of the result")
    else:
        print_next("\nnot saved; `--out DIR` saves the best design")
    stop_if_interrupted(tuned.outcome)
    fail_if_diverged(result)
