"""``spacerobot report``: one page about results, a comparison of tuning methods, or a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.api.saved_kinds import saved_kind
from spacerobot.cli.command import LOOK, Command
from spacerobot.cli.commands.animate import PAGES
from spacerobot.cli.output import console, progress
from spacerobot.cli.plugins import load_plugins_of
from spacerobot.common.errors import ResultError
from spacerobot.result.store import SUMMARY

Folders = Annotated[
    list[Path],
    typer.Argument(
        metavar="DIR...",
        help="Folders of results, or one that holds several; or one comparison, campaign, plan or analysis.",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File of the page; FIRST/report.html if not given."),
]


@Command.of("report", place=3, group=LOOK)
def command(folders: Folders, out: Out = None) -> None:
    """Write one self-contained page: outcome, animation, headline numbers, figures, ledger, warnings.

    For a folder written by `spacerobot compare` the page compares the tuning methods; for one written by
    `spacerobot campaign` it reports the campaign, finished or not, with the worst samples animated; for one
    written by `spacerobot plan` the motion, the limits that bind, the cost and the replay. A folder of
    `spacerobot margins`, and the files of `reliability`, `falsify` and `identify`, of batches and of
    gradients, give tables and figures.

    Examples:

        spacerobot report out/paper

        spacerobot report out/before out/after --out report.html

        spacerobot report out/compare

        spacerobot report out/campaign

        spacerobot report out/plan

        spacerobot report out/margins

        spacerobot report out/rare.json
    """
    if out is not None and out.suffix.lower() not in PAGES:
        raise ResultError(f"found {out}, allowed: a file {' or '.join(PAGES)}", where="--out")
    for path in folders:
        if not list(path.glob(f"*/{SUMMARY}")):  # a folder may hold several results
            saved_kind(path)
    load_plugins_of([folder for folder in folders if not folder.is_file()])
    first = folders[0]
    path = out or (first.with_suffix(".html") if first.is_file() else first / "report.html")
    with progress("writing the report") as tell:
        sr.report(folders, path, progress=tell)
    console().print(f"report in {path}", markup=False, soft_wrap=True)
