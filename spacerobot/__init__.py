"""Robot arms on floating bases that dock with, grip and move a floating object: simulate, tune, show.

    import spacerobot as sr

    result = sr.simulate(sr.load_scene("paper"))

The names below are loaded when they are first used, so that importing the package takes no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.front_door import front_door

if TYPE_CHECKING:
    from spacerobot.closedloop import ClosedLoop as ClosedLoop
    from spacerobot.closedloop import build_closed_loop as build_closed_loop
    from spacerobot.elements import load_plugin as load_plugin
    from spacerobot.elements import register as register
    from spacerobot.errors import SpaceRobotError as SpaceRobotError
    from spacerobot.result import Result as Result
    from spacerobot.result import load as load
    from spacerobot.result import save as save
    from spacerobot.rollout import Rollout as Rollout
    from spacerobot.rollout import build_rollout as build_rollout
    from spacerobot.scene import Scene as Scene
    from spacerobot.scene import load_scene as load_scene
    from spacerobot.simulation import simulate as simulate
    from viz.studio.server import studio as studio

__version__ = "0.1.0"

_HOME = {
    "ClosedLoop": "spacerobot.closedloop",
    "Result": "spacerobot.result",
    "Rollout": "spacerobot.rollout",
    "Scene": "spacerobot.scene",
    "SpaceRobotError": "spacerobot.errors",
    "build_closed_loop": "spacerobot.closedloop",
    "build_rollout": "spacerobot.rollout",
    "load": "spacerobot.result",
    "load_plugin": "spacerobot.elements",
    "load_scene": "spacerobot.scene",
    "register": "spacerobot.elements",
    "save": "spacerobot.result",
    "simulate": "spacerobot.simulation",
    "studio": "viz.studio.server",
}
"""Where each name of the front door lives."""

__all__ = ["__version__", *_HOME]  # noqa: PLE0604 (names that are loaded when used)
__getattr__, __dir__ = front_door(__name__, _HOME)
