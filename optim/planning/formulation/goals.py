"""What holds at the end, as rows."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca

from optim.planning.formulation.names import find_frame, find_robot, find_still, find_tip, joints_named
from optim.planning.formulation.stage import Stage
from spacerobot.elements.goal import Goal
from spacerobot.elements.instant import Frame, Joint, Row, zero
from spacerobot.errors import ScenarioError

T = TypeVar("T")


def goal_rows(stage: Stage, name: str, goal: Goal) -> list[Row]:
    """Rows of one goal.

    Raises
    ------
    ScenarioError
        If it names what there is not.
    """
    scene = stage.scene
    rows = list(goal.rows(Seen(stage, f"plan.goals.{name}")))
    if goal.rests:
        body = next(body for body in scene.bodies if body.name == goal.body)
        rows += [
            zero(f"rate of {scene.model.names[j]}", "rad/s or m/s", stage.v[scene.model.idx_vs[j]])
            for j in body.driven_joints
        ]
    return [dataclasses.replace(row, name=f"{name}: {row.name}") for row in rows]


@dataclass(frozen=True, eq=False)
class Seen:
    """What a section sees of an instant: a :class:`spacerobot.elements.instant.Instant`.

    Attributes
    ----------
    stage
        The instant.
    where
        Dotted path of the section, for messages.
    """

    stage: Stage
    where: str

    @property
    def axes(self) -> Sequence[int]:
        """Along which things move."""
        return self.stage.scene.translation_axes

    @property
    def turns(self) -> Sequence[int]:
        """About which things turn."""
        return self.stage.scene.rotation_axes

    def tip(self, label: str, key: str = "tip") -> Frame:
        """A tip, by robot/tip."""
        return self._frame(find_tip(self.stage.scene, label, f"{self.where}.{key}").frame)

    def mating(self, link: str, key: str = "frame") -> Frame:
        """A link of the target."""
        return self._frame(find_frame(self.stage.scene, link, f"{self.where}.{key}"))

    def root(self, body: str, key: str) -> tuple[ca.SX, ca.SX]:
        """Velocity and spin of a floating root link, its own axes."""
        model = self.stage.scene.model
        joint = find_still(self.stage.scene, body, f"{self.where}.{key}").root_joint
        first, size = int(model.idx_vs[joint]), int(model.nvs[joint])
        middle = first + size - (3 if size == 6 else 1)
        return self.stage.v[first:middle], self.stage.v[middle : first + size]

    def base(self, robot: str, key: str) -> Frame:
        """The floating root link of a robot."""
        scene, where = self.stage.scene, f"{self.where}.{key}"
        body = find_robot(scene, robot, where)
        if not body.root_joint:
            raise ScenarioError(
                f"the base of {robot!r} is fixed, so its attitude never changes; give it `joint: free_flyer` "
                "or `planar`",
                source=scene.source,
                where=where,
            )
        return self._frame(body.root_frame)

    def joints(self, robot: str, given: Mapping[str, T], key: str) -> Iterator[tuple[Joint, T]]:
        """Joints of a robot that patterns name, and what is given for each."""
        scene = self.stage.scene
        body = find_robot(scene, robot, f"{self.where}.robot")
        for name, joint, each in joints_named(scene, body, given, f"{self.where}.{key}"):
            own = scene.model.joints[joint]
            yield Joint(name, self.stage.q[own.idx_q : own.idx_q + own.nq]), each

    def turned(self, wanted: ca.SX, found: ca.SX) -> ca.SX:
        """Rotation vector from one orientation to another."""
        return self.stage.turned(wanted, found)

    def _frame(self, frame: int) -> Frame:
        return Frame(*self.stage.placement(frame), *self.stage.velocity(frame))
