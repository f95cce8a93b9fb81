"""``spacerobot sweep``: sensitivity of the GA to its settings."""

from __future__ import annotations

import json

from spacerobot.cli.command import Command
from spacerobot.cli.options import Changes, Machines, Out, ScenarioName, Threads, parse_changes
from spacerobot.cli.output import console, table
from spacerobot.cli.tuning_options import (
    Budget,
    Runs,
    Seed,
    Variables,
    Variant,
    chosen_variables,
    journals,
    shown,
)


@Command.of("sweep", place=11)
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
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    from optim import EvolutionSettings, SearchSession, build_problem
    from optim.comparison.statistics import statistics
    from optim.comparison.sweep import sweep
    from optim.problem.scene_recipe import tuning_of
    from optim.workers.dask import open_workers
    from spacerobot.files import write_text

    tuning = tuning_of(scene)
    chosen = chosen_variables(variables, tuning)
    rows, data = [], []
    with shown() as (tell, report), open_workers(threads, dask) as workers:
        tell("building and compiling")
        problem = build_problem(scene, variables=chosen, variant=variant, workers=workers)
        protocol = EvolutionSettings(population=tuning.population, budget=budget or 1000)
        session = SearchSession(journals(out, "sweep.json"), workers, report)
        trials = sweep(problem, protocol=protocol, runs=runs or 3, seed=seed or 0, session=session)
        for trial in trials:
            found = statistics(trial.objectives)
            data.append({"setting": trial.setting, "value": trial.value, **found})
            numbers = [f"{found[key]:.6g}" for key in ("best", "median", "worst")]
            rows.append([trial.setting, f"{trial.value:g}", *numbers])
    title = f"GA, {budget} rollouts a run, {runs} runs each; the rest as in the paper"
    console().print(table(title, ("setting", "value", "best", "median", "worst"), rows))
    if out is not None:
        write_text(out / "sweep.json", json.dumps(data, indent=1) + "\n")
