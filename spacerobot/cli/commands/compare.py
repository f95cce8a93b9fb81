"""``spacerobot compare``: every tuning method on the same problems."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from spacerobot.cli import page_data as playing
from spacerobot.cli.command import Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import (
    Changes,
    Machines,
    Out,
    Port,
    Threads,
    View,
    existing_scenario,
    parse_changes,
)
from spacerobot.cli.output import console, table, warn
from spacerobot.cli.tuning_options import Budget, Runs, Seed, Starts, journals, parts, shown

if TYPE_CHECKING:
    from optim.comparison.tables import ComparisonTable

SUITE = "suite"

Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A scenario, as for `run`; or `suite`: the shipped benchmark problems.",
        callback=lambda name: name if name == SUITE else existing_scenario(name),
    ),
]
Methods = Annotated[
    str | None,
    typer.Option(
        "--methods",
        metavar="LIST",
        help="Methods, separated by commas; those of the tuning section if not given.",
    ),
]
Variants = Annotated[
    str | None,
    typer.Option("--variants", metavar="LIST", help="Variants of the tuning section, separated by commas."),
]
Sets = Annotated[
    str | None,
    typer.Option("--sets", metavar="LIST", help="Sets of variables, separated by commas; all if not given."),
]
Problems = Annotated[
    str | None, typer.Option("--problems", metavar="LIST", help="Problems of the suite, separated by commas.")
]
Full = Annotated[
    bool,
    typer.Option(
        "--full",
        help="Give every method the section's `budget` instead of its `baseline_budget`.",
    ),
]
Page = Annotated[
    bool, typer.Option("--report", help="Also write DIR/report.html, as `spacerobot report DIR` does.")
]


LEGEND = (
    "Targets: relative gap to the best known value over all methods and runs of the problem. Expected "
    "running time: total cost of all runs divided by the number of runs that reached the target. Costs are "
    "in rollouts, of all runs together in the column spent. nlp_ga is charged all runs of the GA that it "
    "starts from. manual knows no bounds and is not ranked. Times are of this machine, under its load."
)


@Command.of("compare", place=10)
def command(
    scenario: Name,
    out: Out = None,
    changes: Changes = None,
    methods: Methods = None,
    variants: Variants = None,
    sets: Sets = None,
    problems: Problems = None,
    budget: Budget = None,
    runs: Runs = None,
    starts: Starts = None,
    seed: Seed = None,
    threads: Threads = None,
    dask: Machines = None,
    full: Full = False,
    page: Page = False,
    view: View = False,
    port: Port = 7000,
) -> None:
    """Run every tuning method on the same problems and compare objectives, costs and robustness.

    The conclusion is printed first. Costs are operations of the generated code, in plain rollouts; see
    `docs/explanation/tuning_methods.md`. An interrupted comparison resumes when it is started again with
    the same --out.

    Examples:

        spacerobot compare paper --out out/compare --report

        spacerobot compare suite --out out/suite --report

        spacerobot compare my.yaml --methods ga,nlp --runs 3 --budget 2000
    """
    from optim.comparison import SearchSession, compare
    from optim.comparison.compare import even_effort
    from optim.comparison.report import to_data
    from optim.comparison.results import write
    from optim.comparison.suite import compare_suite
    from optim.comparison.tables import markdown
    from optim.problem.scene_recipe import tuning_of
    from optim.workers.dask import open_workers
    from spacerobot.files import write_text
    from spacerobot.scene import load_scene
    from viz.figures.comparison import write_figures
    from viz.report.comparison_section import comparison_report

    for asked_for, name in ((page, "--report"), (view, "--view")):
        if asked_for and out is None:
            raise typer.BadParameter("needs --out DIR, where what it shows is written", param_hint=name)
    asked = {"budget": budget, "runs": runs, "starts": starts, "seed": seed}
    with shown() as (tell, report), open_workers(threads, dask) as workers:
        session = SearchSession(journals(out, "comparison.json"), workers, report, tell)
        if scenario == SUITE:
            _refuse(
                "suite", {"--variants": variants, "--sets": sets, "--set": changes, "--full": full or None}
            )
            found = compare_suite(parts(problems), methods=parts(methods), effort=asked, session=session)
        else:
            _refuse("scenario", {"--problems": problems})
            picked: dict[str, Any] = {
                "methods": parts(methods),
                "variants": parts(variants),
                "sets": parts(sets),
            }
            scene = load_scene(scenario, parse_changes(changes))
            effort = even_effort(tuning_of(scene), asked, full=full)
            found = compare(scene, **picked, effort=effort, session=session)
        if out is None:
            data = to_data(found)
        else:
            tell("simulating and saving the best designs")
            data = write(found, out)
            write_text(out / "comparison.md", markdown(data))
            tell("drawing")
            write_figures(data, out)
            if page:
                tell("writing the report")
                write_text(out / "report.html", comparison_report(out))
    show(data)
    console().print(f"\n{found.wall_s:.0f} s in all", markup=False)
    if out is not None:
        what = "report.html, comparison.json and figures" if page else "comparison.json and figures"
        console().print(f"{what} in {out}", markup=False, soft_wrap=True)
    if found.interrupted:
        warn("interrupted: the results so far are kept")
        raise typer.Exit(130)
    if view and out is not None:
        serve(playing.comparison(out, print).data, port)


ROOMY = 96  # columns from which on intervals stand beside running times


def _refuse(what: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not fit what is compared."""
    for name, value in given.items():
        if value:
            raise typer.BadParameter(f"does not go with a {what}", param_hint=name)


def show(data: Mapping[str, Any]) -> None:
    """Print a comparison: the conclusion, all problems in one table, then each problem's tables."""
    from optim.comparison import tables

    console().print(f"\n{data['conclusion']}\n", markup=False, style="bold")
    _print(tables.summary_table(data), keys=2)
    for benchmark in data["problems"]:
        console().rule(escape(tables.heading(benchmark)), align="left", style="dim")
        console().print(tables.prices(benchmark), markup=False)
        narrow = console().width < ROOMY
        for made in tables.tables_of(benchmark, data["precisions"], narrow=narrow):
            _print(made)
        for doubt in tables.doubts(benchmark):
            warn(doubt)
    console().print(LEGEND, markup=False)


def _print(made: ComparisonTable, keys: int = 1) -> None:
    console().print(table(made.title, made.headings, made.rows, keys=keys))
