"""The scene that a tuning problem is about, and how it is sent to other processes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.elements.core.registry import load_plugin, plugins
from spacerobot.scenario import Tuning
from spacerobot.scenario.document import MISSING_SECTIONS
from spacerobot.scenario.load import to_document, validate
from spacerobot.scene import Scene, build_scene

NewVariables = Mapping[str, tuple[str, float, float]]
"""(Dotted path, lower, upper) by name."""


@dataclass(frozen=True)
class SceneRecipe:
    """A scene as plain data that can be sent to another process.

    Attributes:
        document: The resolved scenario.
        source: File of the scenario, named in errors; paths of URDFs are relative to it.
        plugins: Files of plugins that register further kinds of elements.
    """

    document: Mapping[str, Any]
    source: str | None
    plugins: tuple[str, ...] = ()

    @classmethod
    def of(cls, scene: Scene) -> SceneRecipe:
        """Recipe that builds a scene again."""
        source = None if scene.source is None else str(scene.source)
        return cls(to_document(scene.scenario), source, tuple(map(str, plugins())))

    def build(self) -> Scene:
        """The scene."""
        for plugin in self.plugins:
            load_plugin(Path(plugin))
        source = None if self.source is None else Path(self.source)
        return build_scene(validate(dict(self.document), source=source), source=source)


@dataclass(frozen=True)
class BuildRecipe:
    """Recipe of an object that another process builds from a scene.

    Attributes:
        scene: The scene.
        make: Function of a module or class that returns the object for the scene and the options.
        options: Keyword arguments of ``make``, as plain data.
    """

    scene: SceneRecipe
    make: Callable[..., Any]
    options: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Hash of the recipe."""
        plain = [asdict(self.scene), self.make.__qualname__, self.options]
        return hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode()).hexdigest()

    def build(self) -> Any:
        """The object."""
        return self.make(self.scene.build(), **self.options)


def tuning_of(scene: Scene) -> Tuning:
    """The scene's tuning section.

    Raises:
        ScenarioError: If it has none.
    """
    if scene.scenario.tuning is None:
        raise scene.error(MISSING_SECTIONS["tuning"], "tuning")
    return scene.scenario.tuning


def changed_scene(scene: Scene, variant: str | None = None) -> Scene:
    """The scene with the changes of its tuning section, and those of a variant.

    Raises:
        ScenarioError: If there is no such variant, or the path of a change does not exist.
    """
    check_choices(scene, variants=() if variant is None else (variant,))
    tuning = tuning_of(scene)
    changes = dict(tuning.changes) | (tuning.variants[variant] if variant is not None else {})
    return build_scene(scene.scenario, changes, source=scene.source) if changes else scene


def with_variables(
    scene: Scene, variables: NewVariables | Sequence[str] | None
) -> tuple[Scene, Sequence[str] | None]:
    """The scene with new variables in its tuning section, and the names of the chosen variables.

    Raises:
        ScenarioError: If there is no such variable, or a new one is not (dotted path, lower, upper).
    """
    section = scene.scenario.tuning
    if not isinstance(variables, Mapping):
        if variables is None:
            return scene, None
        check_choices(scene, variables=variables)
        sets = tuning_of(scene).sets
        return scene, [name for name_or_set in variables for name in sets.get(name_or_set, (name_or_set,))]
    for name, bounds in variables.items():
        if not (isinstance(bounds, tuple | list) and len(bounds) == 3 and isinstance(bounds[0], str)):
            message = f"found {bounds!r}, required: (dotted path, lower, upper)"
            raise ScenarioError(message, where=f"variables.{name}")
    sections = {name: {"paths": [p], "lower": a, "upper": b} for name, (p, a, b) in variables.items()}
    changes: dict[str, object] = {"tuning.sets": {}, "tuning.variables": sections}
    if section is None:
        changes = {"tuning": {"variables": sections}}
    return build_scene(scene.scenario, changes, source=scene.source), list(sections)


def check_choices(
    scene: Scene,
    *,
    variables: Sequence[str] = (),
    sets: Sequence[str] = (),
    variants: Sequence[str] = (),
) -> None:
    """Check names of the tuning section.

    Args:
        scene: A scene with a ``tuning`` section.
        variables: Names of variables or of sets of them.
        sets: Names of sets of variables.
        variants: Names of variants.

    Raises:
        ScenarioError: If the section has no such variable, set or variant, or is missing.
    """
    tuning = tuning_of(scene)
    choices = (
        ("variable or set", "variables", variables, [*tuning.sets, *tuning.variables]),
        ("set of variables", "sets", sets, tuning.sets),
        ("variant", "variants", variants, tuning.variants),
    )
    for what, key, names, allowed in choices:
        for name in names:
            if name not in allowed:
                raise scene.error(f"no {what} {name!r}; {near_names(name, allowed)}", f"tuning.{key}")
