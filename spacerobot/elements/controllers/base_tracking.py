"""Tracking of a planned motion of a floating base; see :mod:`spacerobot.elements.controllers.base_plan`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from spacerobot.common.section import Name, quantity
from spacerobot.elements.controllers.base_plan import PLANAR, planned_parts, planned_wrench
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part, RobotProperties
from spacerobot.elements.references.knot_motion import Knots
from spacerobot.elements.references.plan_following import (
    BaseMotion,
    PlanFollower,
    known,
    plan_phase,
)


@register
class BaseTracking(PlanFollower, RobotController):
    """Forces and torques of a planned motion of the base, and feedback of its rates; actuators deliver."""

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    kind: Literal["base_tracking"] = "base_tracking"
    phase: Name | None = plan_phase()
    knots: BaseMotion | None = Field(
        default=None, description="points of the planned trajectory, if not in a file"
    )
    kd_linear: float = quantity("N s/m", "gain of the velocity", default=0.0, ge=0)
    kd_angular: float = quantity("N m s/rad", "gain of the spin", default=0.0, ge=0)
    feed_forward: float = quantity("1", "fraction of the planned wrench that is commanded", default=1.0, ge=0)

    @classmethod
    def read(cls, file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
        """Motion of the robot's base."""
        from spacerobot.elements.references.plan_file import read_base

        return read_base(file, where, phase)

    @property
    def planned(self) -> BaseMotion:
        """The planned motion, which was given or read."""
        return known(self.knots)

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Force, torque or both, by the axes that are planned."""
        return planned_parts(self.planned)

    def build(self, robot: RobotContext) -> Contribution:
        """Wrench on the base."""
        motion, model = self.planned, robot.plant.model
        knots = Knots.at(robot.context, np.array(motion.times), motion.points, motion.time(robot))
        first, size = int(model.idx_vs[robot.base_joint]), int(model.nvs[robot.base_joint])
        wrench = planned_wrench(robot, motion, knots, "knots", robot.plant.v[first : first + size])
        events = () if knots.event is None else (knots.event,)
        return Contribution(torques=(wrench,), events=events)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Axes that a planar base does not have."""
        for axis in self.planned.axes:
            if robot.base == "planar" and axis not in PLANAR:
                yield "knots.axes", f"found {axis!r}, allowed for a planar base: {', '.join(PLANAR)}"

    def assumptions(self) -> list[str]:
        """Assumptions of its model, for the user."""
        return ["knows the velocity and the spin of the base without errors"]

    def words(self) -> str:
        """Gains and plan."""
        plan = f"{len(self.planned.times)} points over {self.planned.times[-1]:g} s"
        return f"base_tracking {self.kd_linear:g} / {self.kd_angular:g} along a plan of {plan}"
