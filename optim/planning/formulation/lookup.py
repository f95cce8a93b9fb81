"""Look up the tips, links, robots and joints of a scene that a plan section names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import pinocchio as pin

from spacerobot.errors import ScenarioError, near_names
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneTip
from spacerobot.section import matching

T = TypeVar("T")


def find_tip(scene: Scene, label: str, where: str) -> SceneTip:
    """Tip by robot/tip.

    Raises
    ------
    ScenarioError
        If there is none; the near names are listed.
    """
    return _named(scene, {tip.label: tip for tip in scene.tips}, f"tip {label!r}", label, where)


def find_frame(scene: Scene, frame: str, where: str) -> int:
    """Id of a link's frame of the target.

    Raises
    ------
    ScenarioError
        If there is no target, or no such link.
    """
    if scene.target is None:
        raise ScenarioError("there is no target", source=scene.source, where=where)
    links = [link.name for link in scene.target.description.links]
    if frame not in links:
        raise ScenarioError(
            f"no link {frame!r} in the target's URDF; {near_names(frame, links)}",
            source=scene.source,
            where=where,
        )
    return int(scene.model.getFrameId(f"target/{frame}", pin.FrameType.BODY))


def find_robot(scene: Scene, name: str, where: str) -> SceneBody:
    """Robot by its name.

    Raises
    ------
    ScenarioError
        If there is none; the near names are listed.
    """
    return _named(scene, {body.name: body for body in scene.robots}, f"robot {name!r}", name, where)


def _named(scene: Scene, there: Mapping[str, T], what: str, name: str, where: str) -> T:
    if name not in there:
        raise ScenarioError(f"no {what}; {near_names(name, there)}", source=scene.source, where=where)
    return there[name]


def find_still(scene: Scene, name: str, where: str) -> SceneBody:
    """Body that can come to rest.

    Raises
    ------
    ScenarioError
        If there is none of that name, or its base is fixed.
    """
    bodies = {body.name: body for body in scene.bodies}
    if name not in bodies:
        raise ScenarioError(f"no body {name!r}; {near_names(name, bodies)}", source=scene.source, where=where)
    if not bodies[name].root_joint:
        raise ScenarioError(
            f"the base of {name!r} is fixed, so it is always at rest",
            source=scene.source,
            where=where,
        )
    return bodies[name]


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
