"""``spacerobot figures``: draw a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

import spacerobot as sr
from spacerobot.api.saved_kinds import SIMULATION, saved_kind
from spacerobot.cli.command import LOOK, Command
from spacerobot.cli.options import reported_at
from spacerobot.cli.output import console, progress
from spacerobot.cli.plugins import check_folders, load_plugins_of
from spacerobot.cli.tuning_options import parts
from spacerobot.common.registry import FIGURES

ResultFolder = Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")]
Compare = Annotated[
    Path | None, typer.Option("--compare", metavar="OTHER", help="Another result, drawn in the same figures.")
]
Folder = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the files; RESULT/figures by default."),
]
Formats = Annotated[str, typer.Option("--format", metavar="LIST", help="pdf, svg, png, separated by commas.")]
Only = Annotated[
    list[str] | None, typer.Option("--only", metavar="NAME", help="Draw this figure alone. Repeatable.")
]

Width = Annotated[
    Literal["single", "double"],
    typer.Option(
        "--width", metavar="NAME", help="single or double: one column of a journal (89 mm) or two (183 mm)."
    ),
]


@Command.of("figures", place=4, group=LOOK)
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
    from viz.figure_formats import check_formats

    file_formats = parts(formats) or []
    with reported_at("--format"):
        check_formats(file_formats)
    folders = [folder for folder in (result, compare) if folder is not None]
    check_folders(folders)
    load_plugins_of(folders)
    if saved_kind(result) == SIMULATION:  # figures of plans, margins, ... are drawn together
        with reported_at("--only"):
            for name in only or ():
                FIGURES.check(name)
    folder = out or result / "figures"
    with progress("drawing"):
        drawings = sr.figures(folders, folder, names=only, formats=file_formats, width=width)
    console().print(f"{len(drawings) * len(file_formats)} files in {folder}", markup=False, soft_wrap=True)
