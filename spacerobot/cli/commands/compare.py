"""``spacerobot compare``: every tuning method on the same problems."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

import spacerobot as sr
from spacerobot.cli.command import TUNE, Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import (
    Changes,
    Machines,
    Out,
    Port,
    Threads,
    View,
    existing_scenario,
    load,
    reported_at,
)
from spacerobot.cli.output import is_narrow, print_next, show, warn
from spacerobot.cli.tuning_options import Budget, Runs, Seed, Starts, parts, shown
from spacerobot.common.registry import TUNING_METHODS

if TYPE_CHECKING:
    from spacerobot.api.options import SearchOptions

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


@Command.of("compare", place=6, group=TUNE)
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
    for is_named, name in ((page, "--report"), (view, "--view")):
        if is_named and out is None:
            raise typer.BadParameter("needs --out DIR, where what it shows is written", param_hint=name)
    settings = {"budget": budget, "runs": runs, "starts": starts, "seed": seed}
    with reported_at("--methods"):
        for method in parts(methods) or ():
            TUNING_METHODS.check(method)
    if scenario == SUITE:
        from optim.comparison.suite_file import check_problems

        _refuse("suite", {"--variants": variants, "--sets": sets, "--set": changes, "--full": full or None})
        with reported_at("--problems"):
            check_problems(parts(problems) or ())
    else:
        _refuse("scenario", {"--problems": problems})
        scene = load(scenario, changes, "tuning")
        from optim.problem.scene_recipe import check_choices

        with reported_at("--variants"):
            check_choices(scene, variants=parts(variants) or ())
        with reported_at("--sets"):
            check_choices(scene, sets=parts(sets) or ())
    with shown() as (tell, report), sr.open_workers(threads, dask) as workers:
        options: SearchOptions = {"workers": workers, "progress": report, "notify": tell}
        if scenario == SUITE:
            compared = sr.compare_suite(
                out, problems=parts(problems), methods=parts(methods), effort=settings, **options
            )
        else:
            compared = sr.compare(
                scene,
                out,
                methods=parts(methods),
                variants=parts(variants),
                sets=parts(sets),
                effort=settings | {"full": full},
                **options,
            )
        if page and out is not None:
            tell("writing the report")
            sr.report(compared, out / "report.html")
    show_comparison(compared.summary)
    for warning in compared.notices():
        warn(warning)
    if out is not None:
        what = "report.html, comparison.json and figures" if page else "comparison.json and figures"
        more = "" if page else f"; `spacerobot report {out}` makes a page of them"
        print_next(f"{what} in {out}{more}")
    if compared.summary["interrupted"]:
        warn("interrupted: the results so far are kept")
        raise typer.Exit(130)
    if view and out is not None:
        serve([out], port)


def show_comparison(data: Mapping[str, Any]) -> None:
    """Print the tables of a comparison in the width of the terminal."""
    from optim.comparison.tables import comparison_content

    show(comparison_content(data, narrow=is_narrow()))


def _refuse(kind: str, options: Mapping[str, object]) -> None:
    """Reject options that do not apply to the comparison."""
    for name, value in options.items():
        if value:
            raise typer.BadParameter(f"does not go with a {kind}", param_hint=name)
