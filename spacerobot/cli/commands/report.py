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
        metavar="DIR...", help="Folders of results, or one that holds several; or one comparison or campaign."
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File of the page; FIRST/report.html if not given."),
]


@Command.of("report", place=6)
def command(folders: Folders, out: Out = None) -> None:
    """Write one self-contained page: scenario, headline numbers, animation, figures, ledger, warnings.

    For a folder written by `spacerobot compare` the page compares the tuning methods; for one written by
    `spacerobot campaign` it reports the campaign, finished or not, with the worst samples animated.

    Examples:

        spacerobot report out/paper

        spacerobot report out/before out/after --out report.html

        spacerobot report out/compare

        spacerobot report out/campaign
    """
    from spacerobot.files import write_text
    from viz.report.report import find_results, write_report

    path = out or folders[0] / "report.html"
    load_plugins_of(folders)
    with progress("writing the report") as tell:
        page = _special_page(folders, tell)
        if page is not None:
            write_text(path, page)
        else:
            first, *others = find_results(folders)
            write_report(first, path, *others)
    console().print(f"report in {path}", markup=False, soft_wrap=True)


Maker = Callable[[Path, Callable[[str], object]], str]


def _special_page(folders: list[Path], tell: Callable[[str], object]) -> str | None:
    """Page about one comparison or one campaign; None for results.

    Raises
    ------
    ResultError
        If a comparison or a campaign is named with others.
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
    """Whether a folder holds no result but a comparison or a campaign, and what makes its page."""
    from optim.campaign.store.folder import HEAD
    from viz.report.comparison_section import COMPARISON, comparison_report

    if (folder / COMPARISON).is_file():
        return "comparison", lambda folder, _: comparison_report(folder)
    if (folder / HEAD).is_file():
        return "campaign", campaign_page
    return None
