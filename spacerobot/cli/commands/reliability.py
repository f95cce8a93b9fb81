"""``spacerobot reliability``: the probability of a rare failure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.commands.falsify import Limit, Metric
from spacerobot.cli.options import Changes, ScenarioName, Threads, load, reported_at
from spacerobot.cli.output import print_next, progress, show
from spacerobot.cli.tuning_options import Seed
from spacerobot.common.registry import ESTIMATORS


@Command.of("reliability", place=4, group=TUNE)
def command(
    scenario: ScenarioName,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="JSON file for the result.")
    ] = None,
    changes: Changes = None,
    metric: Metric = None,
    limit: Limit = None,
    method: Annotated[
        str, typer.Option("--method", metavar="NAME", help="importance, line or subset.")
    ] = "importance",
    variation: Annotated[
        float,
        typer.Option(
            "--variation",
            metavar="V",
            min=1e-3,
            max=1,
            help="Coefficient of variation of the probability at which sampling ends.",
        ),
    ] = 0.1,
    budget: Annotated[
        int, typer.Option("--budget", min=1000, metavar="N", help="Maximum number of rollouts.")
    ] = 20_000,
    seed: Seed = None,
    threads: Threads = None,
) -> None:
    """Probability that a metric exceeds its limit, however rare, over the campaign's uncertain parameters.

    Finds the most probable failures by exact gradients and samples about them. Methods: importance
    (samples about all of them), line (lines along the most probable), subset (simulation by levels,
    without gradients).

    Examples:

        spacerobot reliability paper --metric tip_error_peak --limit 0.008

        spacerobot reliability paper --metric grip_force_peak --limit 30 --method line --out out/rare.json
    """
    with reported_at("--method"):
        ESTIMATORS.check(method)
    scene = load(scenario, changes, "campaign")
    from optim.reliability.bounded_quantity import bounded_quantity

    bounded_quantity(scene, metric, limit)  # refused before the libraries of the search are loaded
    with progress("building and simulating"):
        probability = sr.failure_probability(
            scene,
            metric,
            limit,
            method=method,
            effort=sr.SamplingEffort(variation, budget, seed or 0),
            threads=threads,
        )
    show(probability)
    if out is not None:
        probability.save(out)
        print_next(f"result in {out}; `spacerobot report {out}` makes a page of it")
