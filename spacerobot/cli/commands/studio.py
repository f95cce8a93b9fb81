"""``spacerobot studio``: change a number, see the motion change."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.options import Changes, Port, ScenarioName, parse_changes
from spacerobot.cli.output import console, progress, warn

Folder = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder for everything that the studio saves.")
]
NoBrowser = Annotated[
    bool, typer.Option("--no-browser", help="Print the page's address and open no browser.")
]


@Command.of("studio", place=3)
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
    from spacerobot.scene import load_scene
    from viz.studio.prepared_design import Origin
    from viz.studio.server import Studio

    given = parse_changes(changes)
    scene = load_scene(scenario, given)
    for warning in scene.warnings:
        warn(warning)
    with progress("building the closed loop") as tell:
        studio = Studio(Origin(scene, scenario, tuple(given)), out, port, tell)
    with studio:
        opened = not no_browser and studio.open()
        say = "opened in the browser" if opened else "open this address in a browser"
        console().print(f"{say}: {studio.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
        studio.wait()
