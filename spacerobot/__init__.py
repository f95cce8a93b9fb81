"""Robot arms on floating bases that dock with, grip and move a floating object: simulate, tune, show.

    import spacerobot as sr

    result = sr.simulate(sr.load_scene("paper"))

The names below are loaded when they are first used, so that importing the package takes no time.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

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

__version__ = "0.1.0"

_HOME = {
    "ClosedLoop": "closedloop",
    "Result": "result",
    "Rollout": "rollout",
    "Scene": "scene",
    "SpaceRobotError": "errors",
    "build_closed_loop": "closedloop",
    "build_rollout": "rollout",
    "load": "result",
    "load_plugin": "elements",
    "load_scene": "scene",
    "register": "elements",
    "save": "result",
    "simulate": "simulation",
}
"""Where each name of the front door lives."""

__all__ = ["__version__", *_HOME]  # noqa: PLE0604 (names that are loaded when used)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
