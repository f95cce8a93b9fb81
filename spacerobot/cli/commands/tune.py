"""``spacerobot tune``: tune a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.commands.run import fail_if_diverged
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
from spacerobot.registry import TUNING_METHODS

if TYPE_CHECKING:
    from optim import TuningResult

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


@Command.of("tune", place=8)
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
    from optim import build_problem, effort_of, tune
    from optim.problem.objectives import reading
    from optim.problem.scene_recipe import tuning_of
    from optim.problem.variables import at_bound
    from optim.problem.varied_parameters import vary as varied
    from optim.workers.dask import open_workers
    from spacerobot.scene import load_scene
    from spacerobot.simulation import simulate

    scene = varied(load_scene(scenario, parse_changes(changes)), vary or [])
    tuning = tuning_of(scene)
    effort = effort_of(tuning, budget=budget, baseline_budget=budget, runs=runs, starts=starts, seed=seed)
    with shown() as (tell, report), open_workers(threads, dask) as workers:
        tell("building and compiling")
        chosen = chosen_variables(variables, tuning)
        problem = build_problem(scene, variables=chosen, variant=variant, workers=workers)
        found = tune(problem, method, effort=effort, folder=journals(out, "tuning.json"), progress=report)
        tell("simulating the best design")
        result = simulate(found.scene)
        if out is not None:
            result = result.save(out)
            found.save(out)
    told = {name: f", {end}" for name, end in at_bound(list(found.gains), found.outcome.best.u).items()}
    rows = [(name, f"{value:.6g}{told.get(name, '')}") for name, value in found.gains.items()]
    name, factor, unit = reading(tuning.objective)
    console().print(f"{method}: {name} {factor * found.objective:.6g} {unit}", markup=False)
    console().print(pairs("gains", rows))
    if found.margins:
        console().print(pairs("margins", list(found.margins.items())))
    show_runs(found.outcome.runs, factor)
    if TUNING_METHODS.find(method).shows_trials:
        _show_trials(found)
    console().print(pairs("the best design", result.headline()))
    if out is not None:
        console().print(f"\nresult and tuning.json in {out}", markup=False, soft_wrap=True)
    stop_if_interrupted(found.outcome)
    fail_if_diverged(result)


HEADS = {"largest_error_m": "largest error [m]", "swings_hz": "swings [1/s]"}


def _show_trials(found: TuningResult) -> None:
    """Print the trials of the manual procedure."""
    log = found.outcome.best.log
    heads = list(log[0])
    shown = [HEADS.get(head, head) for head in heads]
    cells = []
    for row in log:
        told = [f"{row[h]:.4g}" if isinstance(row[h], float) else str(row[h]) for h in heads]
        cells.append(["-" if row[h] is None else text for h, text in zip(heads, told, strict=True)])
    console().print(table("the manual procedure, step by step", shown, cells))
