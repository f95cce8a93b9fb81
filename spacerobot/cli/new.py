"""``spacerobot new``: a scenario around one's own URDFs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.output import console, warn

HELP = """Write a scenario that runs at once around robots and a target, ready to tune and to edit.

Bases, posture, gains, bounds and steps follow from the URDFs; comments in the file say how.

Examples:

    spacerobot new --robot planar_arm.urdf --target rectangle.urdf --out mine.yaml

    spacerobot new --robot panda.urdf --tip panda_hand --target satellite_box.urdf --out mine.yaml
"""
Robots = Annotated[
    list[str],
    typer.Option("--robot", metavar="URDF", help="A robot: a file, or a shipped URDF. Repeatable."),
]
Target = Annotated[str, typer.Option("--target", metavar="URDF", help="What is held, likewise.")]
Tips = Annotated[
    list[str] | None,
    typer.Option(
        "--tip", metavar="LINK", help="Link that holds the target; one for all robots, or one for each."
    ),
]
Frames = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="LINK",
        help="Link of the target that is held, one for each robot; by default its massless ends.",
    ),
]
Base = Annotated[
    str | None,
    typer.Option(
        "--base", metavar="KIND", help="free_flyer, planar or fixed; planar by default if all robots are."
    ),
]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Scenario to write; ROBOT.yaml by default.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("new", help=HELP)(command)


def command(
    robot: Robots, target: Target, tip: Tips = None, frame: Frames = None, base: Base = None, out: Out = None
) -> None:
    """Write the scenario and say what was chosen."""
    from spacerobot.errors import ScenarioError
    from spacerobot.files import write_text
    from spacerobot.scene.draft import Order, draft_scenario
    from spacerobot.scene.overlaps import overlaps

    file = out or Path(f"{Path(robot[0]).stem}.yaml")
    if file.exists():
        raise ScenarioError("is there already; name another file by --out", source=file)
    text, scene = draft_scenario(Order(robot, target, tip or (), frame or (), base), file)
    write_text(file, text)
    for warning in (*scene.warnings, *overlaps(scene)):
        warn(warning)
    for grasp in scene.grasps:
        line = f"{grasp.tip.label} holds {grasp.config.frame}, {grasp.tip.body.base.joint} base"
        console().print(line, markup=False, soft_wrap=True)
    console().print(
        f"{file}: try `spacerobot run {file}`, then `tune` and `campaign`", markup=False, soft_wrap=True
    )
