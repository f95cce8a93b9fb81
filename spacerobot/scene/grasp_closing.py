"""Choice of the base that is moved to close each grasp, so that a scene begins closed.

A base with ``close_grasp`` gives way to the grasp it names, and is turned too where it says ``align``. Each
rigid grasp that is left moves the target, or, if the target has given way already, the base of its own robot;
grasps of robots that cannot move come first. What no base can close is a *loop*, as two arms of one robot
form it: its positions must meet as they are described, its velocities are projected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spacerobot.errors import ScenarioError
from spacerobot.scene.scene import Scene, SceneBody, SceneGrasp


@dataclass(frozen=True)
class ClosingBase:
    """A base that gives way so that a grasp begins closed.

    Attributes:
        body: Whose base it is.
        grasp: What it closes.
    """

    body: SceneBody
    grasp: SceneGrasp

    @property
    def own(self) -> int:
        """Frame of the body that shall meet :attr:`other`."""
        return self.grasp.frame if self.body.name == "target" else self.grasp.tip.frame

    @property
    def other(self) -> int:
        """Frame that stays."""
        return self.grasp.tip.frame if self.body.name == "target" else self.grasp.frame

    @property
    def aligns(self) -> bool:
        """Whether the base is turned too."""
        return self.body.base.align

    @property
    def sets_velocity(self) -> bool:
        """Whether the base's velocity follows, and not only its position."""
        return is_rigid(self.grasp)

    @property
    def sets_spin(self) -> bool:
        """Whether the base's spin follows too."""
        return self.grasp.config.fixes_orientation

    @property
    def axes(self) -> int:
        """Number of coordinates of the base's position that are solved for."""
        return 2 if self.body.base.joint == "planar" else 3


def is_rigid(grasp: SceneGrasp) -> bool:
    """Whether a grasp leaves no gap."""
    return grasp.config.fixes_position


def begun(grasps: Sequence[SceneGrasp]) -> tuple[SceneGrasp, ...]:
    """Grasps that hold at the start."""
    return tuple(grasp for grasp in grasps if grasp.config.begins == "closed")


def find_closings(
    bodies: Sequence[SceneBody], grasps: Sequence[SceneGrasp], *, source: Path | None = None
) -> tuple[ClosingBase, ...]:
    """Bases that give way, each behind the body that it follows.

    Raises:
        ScenarioError: If bases wait for each other, or a grasp does not involve the body it shall place.
    """
    # Grasp that each base with ``close_grasp`` gives way to, by name of the body.
    by_name = {grasp.name: grasp for grasp in grasps}
    gives = {
        body.name: by_name[body.base.close_grasp] for body in bodies if body.base.close_grasp is not None
    }
    for one in bodies:
        held = gives.get(one.name)
        if held is not None and one.name not in ("target", held.tip.body.name):
            raise ScenarioError(
                f"grasp {held.name!r} holds {held.tip.label!r}, not a tip of {one.name!r}",
                source=source,
                where=f"{one.path}.base.close_grasp",
            )
        if held is not None and held.config.begins == "open":
            raise ScenarioError(
                f"grasp {held.name!r} begins open, so it places nothing; give a `position`",
                source=source,
                where=f"{one.path}.base.close_grasp",
            )
    grasps = begun(grasps)
    target = next((body for body in bodies if body.name == "target"), None)
    asked = dict(gives)
    free = [g for g in grasps if is_rigid(g) and all(g is not closed for closed in asked.values())]
    for grasp in sorted(free, key=lambda g: bool(g.tip.body.root_joint) and g.tip.body.name not in asked):
        for body in (target, grasp.tip.body):
            if body is not None and body.root_joint and body.name not in gives:
                gives[body.name] = grasp
                # a body must not follow itself, by way of others
                at, visited = body.name, set()
                while at in gives and at not in visited:
                    visited.add(at)
                    at = _followed(at, gives[at])
                if at != body.name:
                    break
                del gives[body.name]
    waiting = [body for body in bodies if body.name in gives]
    order: list[ClosingBase] = []
    while waiting:
        names = {body.name for body in waiting}
        ready = [body for body in waiting if _followed(body.name, gives[body.name]) not in names]
        if not ready:
            stuck = [body for body in waiting if body.base.close_grasp is not None]
            paths = " and ".join(f"{body.path}.base.close_grasp" for body in stuck)
            raise ScenarioError(f"{paths} wait for each other; give one of them a position", source=source)
        order += [ClosingBase(body, gives[body.name]) for body in ready]
        waiting = [body for body in waiting if body not in ready]
    return tuple(order)


def open_grasps(scene: Scene) -> tuple[SceneGrasp, ...]:
    """Grasps that hold at the start and that no base closes in every direction."""
    closed = [
        closing.grasp.name
        for closing in find_closings(scene.bodies, scene.grasps)
        if scene.planar or closing.body.base.joint == "free_flyer"
    ]
    return tuple(grasp for grasp in begun(scene.grasps) if grasp.name not in closed)


def has_loops(scene: Scene) -> bool:
    """Whether a rigid grasp is left that no base closes."""
    return any(is_rigid(grasp) for grasp in open_grasps(scene))


def _followed(name: str, grasp: SceneGrasp) -> str:
    """Body that a body follows which gives way to a grasp."""
    return grasp.tip.body.name if name == "target" else "target"
