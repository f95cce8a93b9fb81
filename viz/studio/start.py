"""Start of the studio: its page is served before the libraries that take long to load are imported."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.common.files import StrPath
from spacerobot.scene.load import read_scenario
from viz.page.loopback import FIRST_PORT
from viz.studio.supported import check_supported
from viz.studio.waiting import WaitingPage

if TYPE_CHECKING:
    from spacerobot.scene import Scene
    from viz.studio.server import Studio

FOLDER = Path("out/studio")
"""Default folder of files."""


def studio(
    scene: Scene | StrPath,
    changes: Mapping[str, Any] | Sequence[tuple[str, Any]] = (),
    *,
    folder: StrPath = FOLDER,
    port: int = FIRST_PORT,
    on_start: Callable[[WaitingPage], object] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Studio:
    """Serve the studio of a scene, a page on which every number can be changed.

    Args:
        scene: Scene from which designs differ, or the name or file of its scenario.
        changes: New values by dotted path, as of :func:`spacerobot.load_scene`.
        folder: Only folder in which files are written.
        port: First port to try; busy ports are skipped.
        on_start: Callback with the server of the page, called when the page can be opened. Until the studio
            takes its place, the page shows what it waits for.
        progress: Callback with a short text, called when a step that may take long begins.

    Returns:
        Studio: Server, which runs until its ``close`` or the end of its ``with`` block, and shows itself as
            the last line of a notebook's cell. Its ``open`` opens a browser. Its address is that of the page
            unless another program has taken the port meanwhile.

    Raises:
        ScenarioError, DescriptionError: If the scenario or a change is not valid.
        SpaceRobotError: If the scene cannot be rolled out, or no port is free.
    """
    pairs = tuple(changes.items() if isinstance(changes, Mapping) else changes)
    if isinstance(scene, str | os.PathLike):
        name = os.fspath(scene)
        check_supported(read_scenario(name, pairs)[0])  # before anybody opens the page
    else:
        name = scene.scenario.name
        check_supported(scene.scenario)
    with WaitingPage(name, port) as waiting:
        if on_start is not None:
            on_start(waiting)
        tell = waiting.telling(progress or (lambda _: None))
        tell("loading the libraries and the scenario")
        from spacerobot.scene import build_scene, load_scene
        from viz.studio.prepared_design import Origin
        from viz.studio.server import Studio

        if isinstance(scene, str | os.PathLike):
            origin = Origin(load_scene(scene, pairs), name, pairs)
        else:
            origin = Origin(build_scene(scene.scenario, pairs, source=scene.source) if pairs else scene)
        tell("building the closed loop")
        return Studio(origin, Path(folder), tell=tell, waiting=waiting)
