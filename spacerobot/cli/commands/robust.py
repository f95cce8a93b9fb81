"""``spacerobot robust``: tune gains for uncertain parameters."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.commands.run import warn_if_open
from spacerobot.cli.options import Changes, Machines, Out, ScenarioName, Threads, parse_changes
from spacerobot.cli.output import console, pairs, table
from spacerobot.cli.tuning_options import (
    Budget,
    Runs,
    Seed,
    Starts,
    Variables,
    Variant,
    chosen_variables,
    journals,
    show_runs,
    shown,
    stop_if_interrupted,
)

Measure = Annotated[
    Literal["mean", "percentile", "worst"],
    typer.Option("--measure", help="What of the samples' objectives is made small."),
]
Percent = Annotated[float, typer.Option("--percent", min=1, max=99, metavar="P", help="Which percentile.")]
Common = Annotated[int, typer.Option("--samples", min=2, metavar="N", help="Samples that are tuned for.")]
Fresh = Annotated[int, typer.Option("--fresh", min=2, metavar="N", help="Samples of the verification.")]
Method = Annotated[str, typer.Option("--method", metavar="NAME", help="ga, de, pso, cmaes or nlp.")]


@Command.of("robust", place=9)
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
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    from optim import effort_of
    from optim.problem.scene_recipe import tuning_of
    from optim.robust.problem import Statistic, build_robust, describe, save_robust, tune_robust
    from optim.workers.dask import open_workers

    tuning = tuning_of(scene)
    effort = effort_of(tuning, budget=budget, baseline_budget=budget, runs=runs, starts=starts, seed=seed)
    folder = journals(out, "robust.json")
    with shown() as (tell, report), open_workers(threads, dask) as workers:
        tell("building and compiling")
        problem = build_robust(
            scene,
            Statistic(measure, percent, samples),
            variables=chosen_variables(variables, tuning),
            variant=variant,
            workers=workers,
        )
        found = tune_robust(problem, method, effort=effort, fresh=fresh, folder=folder, progress=report)
        if out is not None:
            tell("simulating and saving the robust design")
            saved = save_robust(problem, found, out)
    gains = [(name, f"{value:.6g}") for name, value in found.gains.items()]
    console().print(pairs(f"{method}, {measure}: {found.objective:.6g}", gains))
    show_runs(found.outcome.runs)
    for title, designs in (
        (f"objective on the {samples} samples tuned for", found.common),
        (f"objective on {fresh} fresh samples", found.fresh),
    ):
        rows = []
        for name, told in describe(designs).items():
            # statistics of a design, those of means with their intervals
            means = {
                key: f"{told[key]:.4g} ({told[f'{key}_low']:.4g} to {told[f'{key}_high']:.4g})"
                for key in ("mean", *(("change",) if told["change"] else ()))
            }
            plain = [f"{told[key]:.4g}" for key in COLUMNS[1:-1]]
            rows.append([name, means["mean"], *plain, means.get("change", "")])
        console().print(table(title, ("tuned", *COLUMNS), rows))
    if out is not None:
        warn_if_open(saved)
        console().print(f"result and robust.json in {out}", markup=False, soft_wrap=True)
    stop_if_interrupted(found.outcome)


COLUMNS = ("mean (95 % interval)", "median", "95 %", "largest", "diverged", "change of the mean")
