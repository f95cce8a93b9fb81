"""``spacerobot animate``: play a result in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import LOOK, Command
from spacerobot.cli.options import Port, arguments_as_options
from spacerobot.cli.output import console, progress
from spacerobot.cli.plugins import check_folders, load_plugins_of
from spacerobot.common.errors import ResultError
from spacerobot.common.interrupts import keep

if TYPE_CHECKING:
    from viz.page.live import LiveViewer

Folders = Annotated[
    list[Path],
    typer.Argument(metavar="DIR...", help="Results; or one comparison, campaign or plan."),
]
Compare = Annotated[
    Path | None, typer.Option("--compare", metavar="OTHER", help="Another result, as if named with DIR.")
]
Html = Annotated[
    Path | None,
    typer.Option("--html", metavar="FILE", help="Write one self-contained page instead of serving it."),
]
Record = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE", help="Write a recording instead: .gif, .mp4, or one .png."),
]
Speed = Annotated[
    float | None,
    typer.Option(
        "--speed",
        metavar="FACTOR",
        min=1e-6,
        help="Speed of a recording relative to real time; by default it lasts at most 20 s.",
    ),
]
At = Annotated[
    float | None,
    typer.Option("--at", metavar="SECONDS", min=0, help="Time of a .png; the first capture by default."),
]
PAGES, RECORDINGS, PICTURE = (".html", ".htm"), (".gif", ".mp4"), ".png"
"""Suffixes of the files of --html and --record."""
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Only print the address.")]


@Command.of("animate", place=2, group=LOOK)
def command(
    folders: Folders,
    compare: Compare = None,
    html: Html = None,
    record: Record = None,
    speed: Speed = None,
    at: At = None,
    port: Port = 7000,
    no_browser: NoBrowser = False,
) -> None:
    """Play results in the browser, or write a page or a recording.

    Several results are shown side by side with their metrics and differences. The folder of a comparison
    gives the untuned design and each method's best, that of a campaign the worst samples among all
    others, that of a plan the result of following it, with the plan drawn pale underneath.

    Examples:

        spacerobot animate out/paper

        spacerobot animate out/paper --record docking.mp4 --speed 2

        spacerobot animate out/docking --record poster.png --at 16.5

        spacerobot animate out/before out/after --html docking.html

        spacerobot animate out/campaign

        spacerobot animate out/flown out/plan
    """
    _check_files(html, record, speed, at)
    folders = [*folders, *([compare] if compare else [])]
    check_folders(folders)
    load_plugins_of(folders)
    if html is None and record is None:
        serve(folders, port, open_browser=not no_browser)
        return
    with progress("reading") as tell:
        for file in (html, record):
            if file is not None:
                with arguments_as_options("at"):
                    sr.animate(folders, file, speed=speed, at=at, progress=tell)
    for kind, file in (("page", html), ("recording", record)):
        if file is not None:
            console().print(f"{kind} in {file}", markup=False, soft_wrap=True)


def _check_files(html: Path | None, record: Path | None, speed: float | None, at: float | None) -> None:
    """Check the suffixes of files, and the options that only some of them use.

    Raises:
        ResultError: If a suffix names no format, or an option has no effect.
    """
    for option, file, suffixes in (("--html", html, PAGES), ("--record", record, (*RECORDINGS, PICTURE))):
        if file is not None and file.suffix.lower() not in suffixes:
            raise ResultError(f"found {file}, allowed: a file {' or '.join(suffixes)}", where=option)
    suffix = "" if record is None else record.suffix.lower()
    if speed is not None and suffix not in RECORDINGS:
        raise ResultError("needs --record FILE.gif or FILE.mp4", where="--speed")
    if at is not None and suffix != PICTURE:
        raise ResultError("needs --record FILE.png, one picture", where="--at")


def serve(folders: Sequence[Path], port: int, *, open_browser: bool = True) -> None:
    """Play results, or one comparison, campaign or plan, until Ctrl-C."""

    def begin(viewer: LiveViewer) -> None:
        console().print(f"playing at {viewer.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
        if open_browser:
            viewer.open()

    with sr.view(folders, port=port, on_start=begin) as viewer:
        keep()
        viewer.wait()
