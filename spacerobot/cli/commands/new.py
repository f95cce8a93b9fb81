"""``spacerobot new``: draft a scenario from URDFs, or begin a plugin."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import BEGIN, Command
from spacerobot.cli.output import console, progress, show
from spacerobot.cli.tuning_options import parts
from spacerobot.common.errors import ScenarioError

Robots = Annotated[
    list[str] | None,
    typer.Option("--robot", metavar="URDF", help="A robot: a file, or a shipped URDF. Repeatable."),
]
Target = Annotated[
    str | None, typer.Option("--target", metavar="URDF", help="The object: a file, or a shipped URDF.")
]
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
Bus = Annotated[
    str | None,
    typer.Option("--bus", metavar="URDF", help="A spacecraft that carries arms, in place of --robot."),
]
Mounts = Annotated[
    list[str] | None,
    typer.Option(
        "--mount",
        metavar="[NAME=]URDF[@X,Y,Z[,R,P,Y]]",
        help="An arm on the bus, at a place [m] and roll, pitch, yaw [deg] in the bus's root link; its links "
        "and joints get NAME_ as prefix. Repeatable; the first one captures.",
    ),
]
Include = Annotated[
    str | None,
    typer.Option(
        "--with",
        metavar="LIST",
        help="Equipment of the base, with --capture: wheels, thrusters, filters, separated by commas.",
    ),
]
Capture = Annotated[
    bool,
    typer.Option("--capture", help="Draft approach, capture and stop, with plan, tuning and campaign."),
]
Point = Annotated[
    str | None,
    typer.Option(
        "--point",
        metavar="X,Y,Z",
        help="With --capture: a point of the target's surface, root link's axes [m], in place of a frame.",
    ),
]
Simulate = Annotated[
    bool,
    typer.Option("--simulate/--no-simulate", help="Whether the draft is simulated before it is written."),
]
Plugin = Annotated[
    str | None,
    typer.Option(
        "--plugin",
        metavar="FAMILY",
        help="Write a plugin that runs and its test, in place of a scenario: a sensor, actuator, controller, "
        "reference, shape, quantity or goal.",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FILE", help="File to write; ROBOT.yaml, or FAMILY.py of a plugin, by default."
    ),
]


@Command.of("new", place=1, group=BEGIN)
def command(
    robot: Robots = None,
    target: Target = None,
    tip: Tips = None,
    frame: Frames = None,
    base: Base = None,
    bus: Bus = None,
    mount: Mounts = None,
    include: Include = None,
    capture: Capture = False,
    point: Point = None,
    simulate: Simulate = True,
    plugin: Plugin = None,
    out: Out = None,
) -> None:
    """Draft a scenario from URDFs of robots and a target, or begin a plugin.

    Bases, posture, gains, bounds and steps are computed from the URDFs. The draft is simulated and
    linearised; a capture is slowed down until it succeeds. Comments in the file say what was found.

    Examples:

        spacerobot new --robot planar_arm.urdf --target rectangle.urdf --out mine.yaml

        spacerobot new --capture --robot panda_arm.urdf --target satellite_box.urdf --out dock.yaml

        spacerobot new --capture --bus satellite_box.urdf --mount arm=panda_arm.urdf@0.5,0,0,0,90,0
            --target satellite_box.urdf --with wheels,filters --out mission.yaml

        spacerobot new --plugin sensor --out my_sensor.py
    """
    if plugin is not None:
        if robot or target or bus:
            message = "a plugin has no robot or target; write the scenario by a command of its own"
            raise ScenarioError(message, where="--plugin")
        drafted_plugin = sr.draft_plugin(plugin, out or Path(f"{plugin}.py"))
        lines = f"{drafted_plugin.file}: written; use it by\n{drafted_plugin.command}\n"
        lines += f"{drafted_plugin.test}: its test; run it by\npytest {shlex.quote(str(drafted_plugin.test))}"
        console().print(lines, markup=False, soft_wrap=True)
        return
    if target is None:
        raise ScenarioError(
            "missing: the URDF of the object, as in "
            "`spacerobot new --capture --robot panda_arm.urdf --target satellite_box.urdf`",
            where="--target",
        )
    request = sr.DraftRequest(
        robot or (),
        target,
        tip or (),
        frame or (),
        base,
        bus,
        mount or (),
        parts(include) or (),
        None if point is None else _coordinates(point),
    )
    request.check_files(out)  # before the packages of a draft are imported
    with progress("drafting") as tell:
        drafted = sr.draft(request, out, capture=capture, simulate=simulate, progress=tell)
    file = drafted.save()
    show(drafted)
    following = "`plan`, `tune` and `campaign`" if capture else "`tune` and `campaign`"
    state = "simulated; show it by" if drafted.is_verified else "written; simulate it by"
    console().print(
        f"{file}: {state} `spacerobot run {file}`, then {following}", markup=False, soft_wrap=True
    )


def _coordinates(text: str) -> list[float]:
    """Numbers of a text ``x,y,z``."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        message = f"found {text!r}, allowed: x,y,z [m] on the object's root link"
        raise ScenarioError(message, where="--point") from None
