"""The scene that a tuning problem is about."""

from __future__ import annotations

from spacerobot.errors import ScenarioError
from spacerobot.scenario import Tuning
from spacerobot.scene import Scene, build_scene


def tuning_of(scene: Scene) -> Tuning:
    """The scene's tuning section.

    Raises
    ------
    ScenarioError
        If it has none.
    """
    if scene.scenario.tuning is None:
        raise ScenarioError("this scenario has no tuning section", source=scene.source, where="tuning")
    return scene.scenario.tuning


def changed_scene(scene: Scene, reading: str | None = None) -> Scene:
    """The scene with the tuning problem's changes, and those of one reading, made.

    Raises
    ------
    ScenarioError
        If a change leads nowhere.
    """
    tuning = tuning_of(scene)
    changes = dict(tuning.changes)
    if reading is not None:
        changes |= tuning.readings[reading]
    return build_scene(scene.scenario, changes, source=scene.source) if changes else scene
