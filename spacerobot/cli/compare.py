"""``spacerobot compare``: every tuning method on the same problems."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.options import Changes, Machines, Out, ScenarioName, Threads, parse_changes
from spacerobot.cli.output import console, table, warn
from spacerobot.cli.tuning_options import Budget, Runs, Seed, Starts, parts, shown

if TYPE_CHECKING:
    from optim import Comparison, Contest

Methods = Annotated[
    str | None,
    typer.Option(
        "--methods", metavar="LIST", help="Among manual, ga, de, pso, cmaes, nlp, nlp_ga; by commas."
    ),
]
Readings = Annotated[
    str | None, typer.Option("--readings", metavar="LIST", help="Readings of the tuning section; by commas.")
]
Sets = Annotated[
    str | None, typer.Option("--sets", metavar="LIST", help="Sets of variables; by commas. All if not given.")
]
Full = Annotated[
    bool, typer.Option("--full", help="Give every evolutionary method the GA's whole budget: twice as long.")
]

HELP = """Tune a scenario by every method and compare what they find, what it costs and how it holds up.

A comparison that was killed goes on where it was when it is started again with the same --out.

Examples:

    spacerobot compare paper --out out/compare

    spacerobot compare my.yaml --methods ga,nlp --runs 3 --budget 2000
"""

LEGEND = (
    "best, median, spread (quartiles): of the objective over runs. Cost: in rollouts, a gradient counted "
    "at its measured {gradient:.0f} (a rollout in a batch takes {rollout:.2f} ms of one core); nlp_ga: what "
    "it adds to the GA. Errors: largest absolute one by tip and axis. Torque, grip: the largest needed. "
    "Other plants: objective on {plants} plants never tuned for, median (worst). Matters: relative change "
    "of the objective, to first order, if the gain crossed its range."
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compare", help=HELP)(command)


def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    methods: Methods = None,
    readings: Readings = None,
    sets: Sets = None,
    budget: Budget = None,
    runs: Runs = None,
    starts: Starts = None,
    seed: Seed = None,
    threads: Threads = None,
    dask: Machines = None,
    full: Full = False,
) -> None:
    """Compare methods; exit code 130 after Ctrl-C, with what was found until then."""
    from optim import compare, effort_of
    from optim.report import to_json, write
    from optim.scenes import tuning_of
    from optim.tables import markdown
    from optim.workers.dask import open_workers
    from spacerobot.files import write_text
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    tuning = tuning_of(scene)
    rivals = budget or (tuning.budget if full else None)
    effort = effort_of(tuning, budget=budget, rival_budget=rivals, runs=runs, starts=starts, seed=seed)
    with shown() as (tell, report), open_workers(threads, dask) as workers:
        found = compare(
            scene,
            methods=parts(methods),
            readings=parts(readings),
            sets=parts(sets),
            effort=effort,
            folder=out / "journals" if out is not None else None,
            workers=workers,
            progress=report,
            tell=tell,
        )
        if out is not None:
            tell("simulating and saving the best designs")
            write(found, out)
            write_text(out / "comparison.md", markdown(to_json(found)))
            draw(found, out)
    for contest in found.contests:
        show(contest)
    console().print(f"\n{found.wall_s:.0f} s in all", markup=False)
    if out is not None:
        console().print(f"comparison.json, figures and results in {out}", markup=False, soft_wrap=True)
    if found.interrupted:
        warn("interrupted: what was found until then is kept")
        raise typer.Exit(130)


def show(contest: Contest) -> None:
    """Print a contest: its table, the claim that it tests, the gains, and which of them matter."""
    from optim import report, tables

    unit = tables.unit_of(contest)[1]
    names = contest.problem.names
    title = f"{contest.name}: objective in {unit}"
    console().print(table(title, tables.COST_HEADINGS, tables.cost_rows(contest)))
    console().print(table(None, ("gains", *names, "at a bound"), tables.gain_rows(contest)))
    console().print(table(None, tables.design_headings(contest), tables.design_rows(contest)))
    console().print(table(None, ("matters", *names), tables.sensitivity_rows(contest)))
    plants = contest.problem.scene.scenario.tuning
    count = plants.robustness.plants if plants is not None else 0
    words = {"gradient": contest.gradient_cost, "rollout": 1e3 * contest.rollout_s, "plants": count}
    console().print(LEGEND.format(**words), markup=False)
    said = report.claim(contest)
    if said is not None:
        console().print(
            f"The NLP's best is {said['objective_ratio']:.4f} of the best of all evolutionary runs, at "
            f"{said['cost_ratio']:.3f} of their cost: {'' if said['met'] else 'NOT '}as good at a tenth.",
            markup=False,
        )


def draw(found: Comparison, folder: Path) -> None:
    """Write convergence, sensitivities and robustness of each contest as figures."""
    from optim.report import convergence
    from optim.tables import unit_of
    from spacerobot.files import write_bytes
    from viz.figures import convergence as draw_convergence
    from viz.figures import robustness, sensitivities
    from viz.figures.style import to_bytes

    for contest in found.contests:
        factor, unit = unit_of(contest)
        best = {name: outcome.best for name, outcome in contest.outcomes.items() if outcome.best.history}
        figures = {}
        for kind, column, step in (("cost", 0, "cost in rollouts"), ("time", 1, "time [s]")):
            lines = {
                name: [(row[column], factor * row[2]) for row in convergence(run, contest.gradient_cost)]
                for name, run in best.items()
            }
            lines = {name: line for name, line in lines.items() if line}
            if lines:
                made = draw_convergence(lines, quantity="objective", unit=unit, step=step)
                figures[f"convergence_{kind}"] = made
        if contest.sensitivity is not None:
            shares = contest.sensitivity.over_range
            figures["sensitivities"] = sensitivities(contest.problem.names, shares, quantity="the objective")
        designs = {"untuned": contest.baseline, **contest.verdicts}
        samples = {name: factor * design.varied["objective"] for name, design in designs.items()}
        figures["robustness"] = robustness(samples, quantity="objective", unit=unit)
        for name, figure in figures.items():
            write_bytes(folder / contest.name / "figures" / f"{name}.svg", to_bytes(figure, "svg"))
