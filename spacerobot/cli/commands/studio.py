"""``spacerobot studio``: change a number, see the motion change."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import LOOK, Command
from spacerobot.cli.options import Changes, Port, ScenarioName, parse_changes
from spacerobot.cli.output import console, progress, warn

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
    from viz.studio.waiting import WaitingPage

    path_changes = parse_changes(changes)
    with WaitingPage(scenario, port) as waiting:
        # the address can be opened at once: its page says what the studio waits for, then becomes the studio
        opened = not no_browser and waiting.open()
        say = "opened in the browser" if opened else "open this address in a browser"
        console().print(f"{say}: {waiting.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
        with progress("loading the studio's libraries and the scenario"):
            from viz.studio.prepared_design import Origin
            from viz.studio.server import Studio

            scene = sr.load_scene(scenario, path_changes)
        for warning in scene.warnings:
            warn(warning)
        with progress("building the closed loop") as tell:
            origin = Origin(scene, scenario, tuple(path_changes))
            studio = Studio(origin, out, waiting.port, waiting.telling(tell), waiting)
    with studio:
        if studio.port != waiting.port:
            console().print(f"the address has changed: {studio.url}", markup=False, soft_wrap=True)
        studio.wait()
