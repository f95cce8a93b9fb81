"""``spacerobot studio``: change a number, see the motion change."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import LOOK, Command
from spacerobot.cli.options import Changes, Port, ScenarioName, changes_named, parse_changes
from spacerobot.cli.output import console, progress, warn

if TYPE_CHECKING:
    from viz.studio.waiting import WaitingPage

Folder = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder for everything that the studio saves.")
]
NoBrowser = Annotated[
    bool, typer.Option("--no-browser", help="Print the page's address and open no browser.")
]


@Command.of("studio", place=1, group=LOOK)
def command(
    scenario: ScenarioName,
    changes: Changes = None,
    out: Folder = Path("out/studio"),
    port: Port = 7000,
    no_browser: NoBrowser = False,
) -> None:
    """Change a scenario's parameters in the browser; motion, curves and metrics update at once.

    Examples:

        spacerobot studio paper

        spacerobot studio my.yaml --set simulation.duration=20 --out out/trials
    """
    addresses = list[str]()

    def announce(page: WaitingPage) -> None:
        """Print the page's address, and open a browser unless it is not desired."""
        addresses.append(page.url)
        opened = not no_browser and page.open()
        words = "opened in the browser" if opened else "open this address in a browser"
        console().print(f"{words}: {page.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)

    with progress("loading") as tell, changes_named(scenario, changes):
        studio = sr.studio(
            scenario, parse_changes(changes), folder=out, port=port, on_start=announce, progress=tell
        )
    for warning in studio.scene.warnings:
        warn(warning)
    with studio:
        if studio.url not in addresses:
            console().print(f"the address has changed: {studio.url}", markup=False, soft_wrap=True)
        studio.wait()
