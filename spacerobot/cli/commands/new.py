"""``spacerobot new``: draft a scenario from URDFs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, warn

Robots = Annotated[
    list[str],
    typer.Option("--robot", metavar="URDF", help="A robot: a file, or a shipped URDF. Repeatable."),
]
Target = Annotated[str, typer.Option("--target", metavar="URDF", help="The object that is held, likewise.")]
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


Capture = Annotated[
    bool,
    typer.Option("--capture", help="Draft approach, capture and stop of one robot, with a plan section."),
]
Point = Annotated[
    str | None,
    typer.Option(
        "--point",
        metavar="X,Y,Z",
        help="With --capture: a point of the target's surface, root link's axes [m], in place of a frame.",
    ),
]


@Command.of("new", place=16)
def command(
    robot: Robots,
    target: Target,
    tip: Tips = None,
    frame: Frames = None,
    base: Base = None,
    out: Out = None,
    capture: Capture = False,
    point: Point = None,
) -> None:
    """Draft a scenario from URDFs of robots and a target, ready to run, tune and edit.

    Bases, posture, gains, bounds and steps are computed from the URDFs; comments in the file explain
    them.

    Examples:

        spacerobot new --robot planar_arm.urdf --target rectangle.urdf --out mine.yaml

        spacerobot new --robot panda.urdf --tip panda_hand --target satellite_box.urdf --out mine.yaml

        spacerobot new --capture --robot panda.urdf --tip panda_hand --target satellite_box.urdf
            --out dock.yaml
    """
    from spacerobot.errors import ScenarioError
    from spacerobot.files import write_text
    from spacerobot.scene.draft import DraftRequest, draft_capture, draft_scenario
    from spacerobot.scene.draft.capture import POINT, surface_point
    from spacerobot.scene.overlaps import overlaps

    file = out or Path(f"{Path(robot[0]).stem}.yaml")
    if file.exists():
        raise ScenarioError("exists already; name another file by --out", source=file)
    if point is not None:
        # the object's URDF with a mating frame at the point
        try:
            place = [float(part) for part in point.split(",")]
        except ValueError:
            place = []
        if len(place) != 3 or not capture or frame:
            raise ScenarioError(
                f"found {point!r}, allowed: x,y,z [m] on the object's root link, with --capture, "
                "without --frame",
                where="--point",
            )
        file_name, object_text = surface_point(target, place, file)
        urdf = file.absolute().parent / file_name
        if urdf.exists():
            raise ScenarioError("exists already; name another file by --out", source=urdf)
        write_text(urdf, object_text)
        target, frame = str(urdf), [POINT]
    draft = draft_capture if capture else draft_scenario
    text, scene = draft(DraftRequest(robot, target, tip or (), frame or (), base), file)
    write_text(file, text)
    for warning in (*scene.warnings, *overlaps(scene)):
        warn(warning)
    for grasp in scene.grasps:
        verb = "captures" if capture else "holds"
        line = f"{grasp.tip.label} {verb} {grasp.config.frame}, {grasp.tip.body.base.joint} base"
        console().print(line, markup=False, soft_wrap=True)
    following = "`plan`, `tune` and `campaign`" if capture else "`tune` and `campaign`"
    console().print(f"{file}: try `spacerobot run {file}`, then {following}", markup=False, soft_wrap=True)
