"""``spacerobot report``: one page about one or several results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.output import console, progress

Folders = Annotated[
    list[Path], typer.Argument(metavar="RESULT...", help="Folders of results, or one that holds several.")
]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page; FIRST/report.html if not given.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", help=HELP)(command)


HELP = """Write one self-contained page: what was run, headline numbers, animation, figures, ledger, warnings.

Examples:

    spacerobot report out/paper

    spacerobot report out/before out/after --out report.html
"""


def command(results: Folders, out: Out = None) -> None:
    """Write the page."""
    from viz.report import find_results, write_report

    found = find_results(results)
    path = out or results[0] / "report.html"
    with progress("writing the report"):
        write_report(path, *found)
    console().print(f"report in {path}", markup=False, soft_wrap=True)
