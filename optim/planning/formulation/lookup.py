"""Look up the robots and joints of a scene that a plan section names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

from spacerobot.errors import ScenarioError, near_names
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody
from spacerobot.section import matching

T = TypeVar("T")


def find_robot(scene: Scene, name: str, where: str) -> SceneBody:
    """Robot by its name.

    Raises
    ------
    ScenarioError
        If there is none; the near names are listed.
    """
    robots = {body.name: body for body in scene.robots}
    if name not in robots:
        raise ScenarioError(
            f"no robot {name!r}; {near_names(name, robots)}", source=scene.source, where=where
        )
    return robots[name]


def joints_named(
    scene: Scene, body: SceneBody, given: Mapping[str, T], where: str
) -> Iterator[tuple[str, int, T]]:
    """Name and number of each joint of a body that a pattern names, and what is given for it.

    Raises
    ------
    ScenarioError
        If a pattern names none.
    """
    ids = {body.joint_name(scene.model, j): j for j in body.driven_joints}
    for pattern, each in given.items():
        names = matching(ids, pattern)
        if not names:
            raise ScenarioError(
                f"no joint {pattern!r}; {near_names(pattern, ids)}", source=scene.source, where=where
            )
        for name in names:
            yield name, ids[name], each
