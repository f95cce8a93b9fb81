"""``spacerobot report``: one page about results, a comparison of tuning methods, or a campaign."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.campaign_page import campaign_page
from spacerobot.cli.command import Command
from spacerobot.cli.output import console, progress
from spacerobot.cli.plugins import load_plugins_of
from spacerobot.errors import ResultError

Folders = Annotated[
    list[Path],
    typer.Argument(
        metavar="DIR...",
        help="Folders of results, or one that holds several; or one comparison, campaign or plan.",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File of the page; FIRST/report.html if not given."),
]


@Command.of("report", place=6)
def command(folders: Folders, out: Out = None) -> None:
    """Write one self-contained page: outcome, animation, headline numbers, figures, ledger, warnings.

    For a folder written by `spacerobot compare` the page compares the tuning methods; for one written by
    `spacerobot campaign` it reports the campaign, finished or not, with the worst samples animated; for one
    written by `spacerobot plan` the motion, the limits that bind, the cost and the replay.

    Examples:

        spacerobot report out/paper

        spacerobot report out/before out/after --out report.html

        spacerobot report out/compare

        spacerobot report out/campaign

        spacerobot report out/plan
    """
    load_plugins_of(folders)
    from spacerobot.files import write_text
    from viz.report.report import find_results, write_report

    path = out or folders[0] / "report.html"
    with progress("writing the report") as tell:
        page = _special_page(folders, tell)
        if page is not None:
            write_text(path, page)
        else:
            first, *others = find_results(folders)
            write_report(first, path, *others)
    console().print(f"report in {path}", markup=False, soft_wrap=True)


Maker = Callable[[Path, Callable[[str], None]], str]


def _special_page(folders: list[Path], tell: Callable[[str], None]) -> str | None:
    """Page about one comparison, campaign or plan; None for results.

    Raises
    ------
    ResultError
        If one of them is named with others.
    """
    from spacerobot.result.store import DATA

    found = [(folder, _special(folder)) for folder in folders]
    for folder, special in found:
        if special is not None and len(folders) > 1:
            raise ResultError(f"a {special[0]} has a page of its own; name it alone", source=folder)
        if special is not None:
            return special[1](folder, tell)
        for inside in sorted(folder.glob("*/")):
            if (kind := _special(inside)) is not None and not (folder / DATA).is_file():
                message = f"holds a {kind[0]}, {inside.name}, among results; name the results, or it alone"
                raise ResultError(message, source=folder)
    return None


def _special(folder: Path) -> tuple[str, Maker] | None:
    """Whether a folder holds no result but a comparison, a campaign or a plan, and what makes its page."""
    from optim.campaign.store.folder import HEAD
    from optim.planning.output.plan_folder import is_plan
    from viz.report.comparison_section import COMPARISON, comparison_report

    if (folder / COMPARISON).is_file():
        return "comparison", lambda folder, _: comparison_report(folder)
    if (folder / HEAD).is_file():
        return "campaign", campaign_page
    if is_plan(folder):
        return "plan", _plan_page
    return None


def _plan_page(folder: Path, tell: Callable[[str], None]) -> str:
    """Page about a plan, and the simulation of the scenario that follows it."""
    from optim.planning.output.plan_folder import read
    from spacerobot.cli.page_data import plan
    from viz.report.plan_section import plan_report

    shown = plan(folder, tell)
    return plan_report(*read(folder), shown.results[0], shown.data)
