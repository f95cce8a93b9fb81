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

A folder that `spacerobot compare` wrote gives a page about the tuning methods.

Examples:

    spacerobot report out/paper

    spacerobot report out/before out/after --out report.html

    spacerobot report out/compare
"""


def command(results: Folders, out: Out = None) -> None:
    """Write the page."""
    from spacerobot.files import write_text
    from viz.comparison_section import COMPARISON, comparison_report
    from viz.report import find_results, write_report

    path = out or results[0] / "report.html"
    with progress("writing the report"):
        if len(results) == 1 and (results[0] / COMPARISON).is_file():
            write_text(path, comparison_report(results[0]))
        else:
            write_report(path, *find_results(results))
    console().print(f"report in {path}", markup=False, soft_wrap=True)
