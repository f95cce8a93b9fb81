"""The scene that a tuning problem is about, and how it travels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spacerobot.elements.registry import load_plugin, plugins
from spacerobot.errors import ScenarioError
from spacerobot.scenario import Tuning
from spacerobot.scenario.load import to_document, validate
from spacerobot.scene import Scene, build_scene


@dataclass(frozen=True)
class SceneRecipe:
    """A scene as plain data that can be sent to another process.

    Attributes
    ----------
    document
        The scenario, resolved.
    source
        File that it came from, for its errors and the URDFs beside it.
    plugins
        Files that add the kinds of elements it may hold.
    """

    document: Mapping[str, Any]
    source: str | None
    plugins: tuple[str, ...] = ()

    @classmethod
    def of(cls, scene: Scene) -> SceneRecipe:
        """What builds a scene again."""
        source = None if scene.source is None else str(scene.source)
        return cls(to_document(scene.scenario), source, tuple(map(str, plugins())))

    def build(self) -> Scene:
        """The scene."""
        for plugin in self.plugins:
            load_plugin(Path(plugin))
        source = None if self.source is None else Path(self.source)
        return build_scene(validate(dict(self.document), source=source), source=source)


def tuning_of(scene: Scene) -> Tuning:
    """The scene's tuning section.

    Raises
    ------
    ScenarioError
        If it has none.
    """
    if scene.scenario.tuning is None:
        raise ScenarioError(
            "this scenario has no tuning section; name what varies by `spacerobot tune --vary kp=20..2000`, "
            "or let `spacerobot new` write a scenario that has one (docs/tuning.md)",
            source=scene.source,
            where="tuning",
        )
    return scene.scenario.tuning


def changed_scene(scene: Scene, variant: str | None = None) -> Scene:
    """The scene with the tuning problem's changes, and those of one variant, made.

    Raises
    ------
    ScenarioError
        If a change leads nowhere.
    """
    tuning = tuning_of(scene)
    changes = dict(tuning.changes)
    if variant is not None:
        changes |= tuning.variants[variant]
    return build_scene(scene.scenario, changes, source=scene.source) if changes else scene
