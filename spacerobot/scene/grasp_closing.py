"""Choice of the base moved to close each grasp, so that a scene starts closed.

A base with ``close_grasp`` is placed by the named grasp, and rotated as well with ``align``. Each remaining
rigid grasp moves the target or, if the target is already placed, the base of its own robot; grasps of robots
that cannot move come first. A grasp that no base can close is in a *loop*, such as two arms of one robot: its
stated positions must fit, its velocities are projected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spacerobot.common.errors import ScenarioError
from spacerobot.scene.scene import Scene, SceneBody, SceneGrasp


@dataclass(frozen=True)
class ClosingBase:
    """Base that is placed so that a grasp starts closed.

    Attributes:
        body: Body of the base.
        grasp: Grasp that it closes.
    """

    body: SceneBody
    grasp: SceneGrasp

    @property
    def own(self) -> int:
        """Frame of the body that is to coincide with :attr:`other`."""
        return self.grasp.frame if self.body.name == "target" else self.grasp.tip.frame

    @property
    def other(self) -> int:
        """Frame that stays."""
        return self.grasp.tip.frame if self.body.name == "target" else self.grasp.frame

    @property
    def aligns(self) -> bool:
        """Whether the base is rotated as well."""
        return self.body.base.align

    @property
    def sets_velocity(self) -> bool:
        """Whether the base's velocity follows the grasp, in addition to its position."""
        return is_rigid(self.grasp)

    @property
    def sets_spin(self) -> bool:
        """Whether the base's spin follows the grasp."""
        return self.grasp.config.fixes_orientation

    @property
    def axes(self) -> int:
        """Number of coordinates of the base's position that are solved for."""
        return 2 if self.body.base.joint == "planar" else 3


def is_rigid(grasp: SceneGrasp) -> bool:
    """Whether a grasp allows no gap."""
    return grasp.config.fixes_position


def begun(grasps: Sequence[SceneGrasp]) -> tuple[SceneGrasp, ...]:
    """Grasps that hold at the start."""
    return tuple(grasp for grasp in grasps if grasp.config.begins == "closed")


def find_closings(
    bodies: Sequence[SceneBody], grasps: Sequence[SceneGrasp], *, source: Path | None = None
) -> tuple[ClosingBase, ...]:
    """Bases to place, each after the body that it follows.

    Raises:
        ScenarioError: If placements depend on each other, or a grasp does not involve the body that it should
            place.
    """
    # Grasp that places each base with ``close_grasp``, by name of the body.
    by_name = {grasp.name: grasp for grasp in grasps}
    gives = {
        body.name: by_name[body.base.close_grasp] for body in bodies if body.base.close_grasp is not None
    }
    for one in bodies:
        to_close = gives.get(one.name)
        if to_close is not None and one.name not in ("target", to_close.tip.body.name):
            raise ScenarioError(
                f"grasp {to_close.name!r} holds {to_close.tip.label!r}, not a tip of {one.name!r}",
                source=source,
                where=f"{one.path}.base.close_grasp",
            )
        if to_close is not None and to_close.config.begins == "open":
            raise ScenarioError(
                f"grasp {to_close.name!r} begins open, so it places nothing; give a `position`",
                source=source,
                where=f"{one.path}.base.close_grasp",
            )
    grasps = begun(grasps)
    target = next((body for body in bodies if body.name == "target"), None)
    assigned = dict(gives)
    free = [g for g in grasps if is_rigid(g) and all(g is not closed for closed in assigned.values())]
    for grasp in sorted(free, key=lambda g: bool(g.tip.body.root_joint) and g.tip.body.name not in assigned):
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
    """Whether a rigid grasp remains that no base closes."""
    return any(is_rigid(grasp) for grasp in open_grasps(scene))


def _followed(name: str, grasp: SceneGrasp) -> str:
    """Body that a body placed by a grasp follows."""
    return grasp.tip.body.name if name == "target" else "target"
