"""Numbers of a scenario that dotted paths name: what can be tuned, and what can be uncertain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import is_number
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand, get
from spacerobot.scene import Scene


@dataclass(frozen=True)
class ScenarioNumber:
    """Number of a scenario that is varied.

    Attributes:
        path: Dotted path of the number.
        pattern: Pattern that matched the path.
        value: The scenario's own.
    """

    path: str
    pattern: str
    value: float


def find_numbers(
    scene: Scene, named: Mapping[str, Sequence[str]], section: str
) -> dict[str, list[ScenarioNumber]]:
    """Numbers of the scenario that match patterns, by the name of the variable that sets them.

    Args:
        scene: The scene.
        named: Patterns by the name of their variable.
        section: Section of the scenario that holds the variables, for errors.

    Raises:
        ScenarioError: If a path is not in the scenario, is no number, or belongs to two variables.
    """
    document, owner = to_document(scene.scenario), dict[str, str]()
    numbers_by_name: dict[str, list[ScenarioNumber]] = {}
    for name, patterns in named.items():
        where = f"{section}.{name}.paths"
        numbers_by_name[name] = []
        for pattern in patterns:
            try:
                paths = expand(document, pattern)
            except ScenarioError as fault:
                raise scene.error(f"{pattern}: {fault.message}", where) from None
            for path in paths:
                if path not in owner:
                    owner[path] = name
                    value = get(document, path)
                    if not is_number(value):
                        raise scene.error(f"{path} is no number, found {value!r}", where)
                    numbers_by_name[name].append(ScenarioNumber(path, pattern, float(value)))
                elif owner[path] != name:
                    message = f"{path} is set by {owner[path]} already"
                    raise scene.error(message, where)
    return numbers_by_name


def numbers_at(scene: Scene, paths: Sequence[str]) -> dict[str, float]:
    """Numbers of a scene's scenario by dotted path.

    Raises:
        ScenarioError: If a path leads to no number.
    """
    document, numbers = to_document(scene.scenario), dict[str, float]()
    for path in paths:
        value = get(document, path)
        if not is_number(value):
            raise ScenarioError(f"found {value!r}, allowed: a number", where=path)
        numbers[path] = value
    return numbers
