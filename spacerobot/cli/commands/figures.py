"""``spacerobot figures``: draw a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, progress
from spacerobot.cli.plugins import load_plugins_of

ResultFolder = Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")]
Compare = Annotated[
    Path | None, typer.Option("--compare", metavar="OTHER", help="Another result, drawn in the same figures.")
]
Folder = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the files; else RESULT/figures."),
]
Formats = Annotated[str, typer.Option("--format", metavar="LIST", help="pdf, svg, png, separated by commas.")]
Only = Annotated[
    list[str] | None, typer.Option("--only", metavar="NAME", help="Draw this figure alone. Repeatable.")
]

Width = Annotated[
    Literal["single", "double"],
    typer.Option("--width", help="One column of a journal (89 mm) or two (183 mm)."),
]


@Command.of("figures", place=5)
def command(
    result: ResultFolder,
    compare: Compare = None,
    out: Folder = None,
    formats: Formats = "pdf,png",
    only: Only = None,
    width: Width = "double",
) -> None:
    """Draw a result: tips, docking, motions, joints, grasps, ledger; or a plan and its simulation.

    Examples:

        spacerobot figures out/paper

        spacerobot figures out/paper --width single --only tip_errors

        spacerobot figures out/before --compare out/after --out figures --format svg

        spacerobot figures out/plan --compare out/flown
    """
    load_plugins_of([folder for folder in (result, compare) if folder is not None])
    from optim.planning.output.constraint_values import with_flown
    from optim.planning.output.plan_folder import SCENARIO, is_plan, read
    from spacerobot.errors import ResultError
    from spacerobot.result import Result
    from spacerobot.scene import load_scene
    from viz.figures import save_figures
    from viz.figures.plan import write_plan_figures

    folder = out or result / "figures"
    wanted = [form.strip() for form in formats.split(",") if form.strip()]
    if is_plan(result):
        if only:
            raise ResultError("the figures of a plan are drawn together; leave out --only", source=result)
        with progress("drawing"):
            plan, summary = read(result)
            flown = None if compare is None else Result.load(compare)
            if flown is not None and "constraint" in plan:
                plan = with_flown(plan, load_scene(result / SCENARIO, expand_xacro=False), flown.data)
            drawn = write_plan_figures(plan, summary, folder, flown=flown, formats=wanted, width=width)
        console().print(f"{len(drawn)} files in {folder}", markup=False, soft_wrap=True)
        return
    results = [Result.load(folder) for folder in (result, compare) if folder is not None]
    with progress("drawing"):
        written = save_figures(results[0], folder, *results[1:], formats=wanted, names=only, width=width)
    console().print(f"{len(written)} files in {folder}", markup=False, soft_wrap=True)
