"""``spacerobot animate``: play a result in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.options import Port
from spacerobot.cli.output import console, progress
from spacerobot.cli.page_data import campaign, campaign_at_once, is_campaign, to_play
from spacerobot.cli.plugins import load_plugins_of
from spacerobot.interrupts import keep

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
    typer.Option("--speed", min=1e-6, help="Of a recording, times real time; else it lasts at most 20 s."),
]
At = Annotated[
    float | None,
    typer.Option("--at", metavar="SECONDS", min=0, help="Of a .png: its time; else the first capture."),
]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Only print the address.")]


@Command.of("animate", place=4)
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
    folders = [*folders, *([compare] if compare else [])]
    load_plugins_of(folders)
    from spacerobot.files import write_text
    from spacerobot.result import note_derived
    from viz.page.page import page

    if html is None and record is None and is_campaign(folders):
        serve_campaign(folders[0], port, open_browser=not no_browser)
        return
    with progress("reading") as tell:
        shown = to_play(folders, tell)
    if html is not None:
        with progress("writing the page"):
            write_text(html, page(shown.data))
            note_derived([result.folder for result in shown.results], [html])
        console().print(f"page in {html}", markup=False, soft_wrap=True)
    if record is not None:
        from viz.record import write_poster, write_recording

        with progress("recording") as tell:
            if record.suffix.lower() == ".png":
                write_poster(shown.results[0], record, at=at)
            else:
                write_recording(shown.results[0], record, speed=speed, progress=tell)
        console().print(f"recording in {record}", markup=False, soft_wrap=True)
    if html is None and record is None:
        serve(shown.data, port, open_browser=not no_browser)


def serve(data: dict[str, Any], port: int, *, open_browser: bool = True) -> None:
    """Play a page's data until Ctrl-C."""
    from viz.page.live import LiveViewer

    with LiveViewer(port) as viewer:
        _begin(viewer, data, open_browser)
        keep()
        viewer.wait()


def serve_campaign(folder: Path, port: int, *, open_browser: bool = True) -> None:
    """Show what a campaign's folder holds, its worst samples once they are simulated, until Ctrl-C."""
    from viz.page.live import LiveViewer

    with progress("opening the campaign"):
        data, evaluator = campaign_at_once(folder)
    with LiveViewer(port) as viewer:
        _begin(viewer, data, open_browser)
        viewer.show_data(campaign(folder, viewer.tell, evaluator).data)
        keep()
        viewer.wait()


def _begin(viewer: LiveViewer, data: dict[str, Any], open_browser: bool) -> None:
    viewer.show_data(data)
    console().print(f"playing at {viewer.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
    if open_browser:
        viewer.open()
