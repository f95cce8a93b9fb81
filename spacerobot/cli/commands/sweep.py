"""``spacerobot sweep``: sensitivity of the GA to its settings."""

from __future__ import annotations

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.options import Changes, Machines, Out, ScenarioName, Threads, load
from spacerobot.cli.output import show
from spacerobot.cli.tuning_options import (
    Budget,
    Runs,
    Seed,
    Variables,
    Variant,
    check_names,
    journals,
    parts,
    shown,
)


@Command.of("sweep", place=7, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    variant: Variant = None,
    variables: Variables = None,
    budget: Budget = 1000,
    runs: Runs = 3,
    seed: Seed = 0,
    threads: Threads = None,
    dask: Machines = None,
) -> None:
    """Sensitivity of the GA to its settings: crossover and mutation probability, population size.

    Example:

        spacerobot sweep paper --variant base --variables five --budget 1000 --runs 3
    """
    scene = load(scenario, changes, "tuning")
    check_names(scene, variables, variant)
    folder = journals(out, "sweep.json")
    with shown() as (tell, report), sr.open_workers(threads, dask) as workers:
        tell("building the closed loop")
        problem = sr.build_problem(scene, variables=parts(variables), variant=variant, workers=workers)
        swept = sr.sweep(
            problem, budget=budget or 1000, runs=runs or 3, seed=seed or 0, folder=folder, progress=report
        )
    show(swept)
    if out is not None:
        swept.save(out)
