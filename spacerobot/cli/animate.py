"""``spacerobot animate``: play a result in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.options import Port
from spacerobot.cli.output import console, progress
from spacerobot.interrupts import keep

if TYPE_CHECKING:
    from spacerobot.result import Result

ResultFolder = Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a result.")]
Compare = Annotated[
    Path | None, typer.Option("--compare", metavar="OTHER", help="Another result, shown beside or over it.")
]
Html = Annotated[
    Path | None,
    typer.Option("--html", metavar="FILE", help="Write one self-contained page instead of serving it."),
]
Record = Annotated[
    Path | None, typer.Option("--record", metavar="FILE", help="Write a recording instead: .gif, or .mp4.")
]
Speed = Annotated[
    float | None,
    typer.Option("--speed", min=1e-6, help="Of a recording, times real time; else it lasts at most 10 s."),
]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Only print the address.")]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("animate", help=HELP)(command)


HELP = """Play a result in the browser, or write a page or a recording of it.

Examples:

    spacerobot animate out/paper

    spacerobot animate out/paper --record docking.mp4 --speed 2

    spacerobot animate out/before --compare out/after --html docking.html
"""


def command(
    result: ResultFolder,
    compare: Compare = None,
    html: Html = None,
    record: Record = None,
    speed: Speed = None,
    port: Port = 7000,
    no_browser: NoBrowser = False,
) -> None:
    """Play, write or record."""
    from spacerobot.result import load

    results = [load(folder) for folder in (result, compare) if folder is not None]
    if html is not None:
        from viz.page.page import write_animation

        with progress("writing the page"):
            write_animation(html, *results)
        console().print(f"page in {html}", markup=False, soft_wrap=True)
    if record is not None:
        from viz.record import write_recording

        with progress("recording") as tell:
            write_recording(record, results[0], speed=speed, progress=tell)
        console().print(f"recording in {record}", markup=False, soft_wrap=True)
    if html is None and record is None:
        _serve(results, port, no_browser)


def _serve(results: list[Result], port: int, no_browser: bool) -> None:
    from viz.page.live import LiveViewer

    with LiveViewer(port) as viewer:
        viewer.show(*results)
        console().print(f"playing at {viewer.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
        if not no_browser:
            viewer.open()
        keep()
        viewer.wait()
