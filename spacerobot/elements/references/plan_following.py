"""Planned motions of the joints and the base of a robot, and of a tip, as sections of a scenario."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self, TypeVar

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.section import Name, Section, Vector, quantity
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.references.knot_motion import is_parted, nodes_of

MOST_POINTS = 2000
Row = tuple[float, ...]
M = TypeVar("M")


class PlanFollower(Section):
    """Section of an element that follows a plan, whose motion is given as ``knots`` or read from a file."""

    fills: ClassVar[str | None] = "knots"
    file: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description="plan.nc of `spacerobot plan`: a path in the scenario's folder; fills in `knots`",
    )
    knots: Any

    @model_validator(mode="after")
    def _check_plan(self) -> Self:
        if self.file is None and self.knots is None:
            raise ValueError("file: which plan? give `file` or `knots`")
        return self


def plan_phase() -> Any:
    """Field of an element that follows one phase of a plan that has several."""
    return Field(default=None, description="which phase of the plan, if not all of it")


def known(knots: M | None) -> M:
    """The planned motion, which was given or read.

    Raises:
        ValueError: If it was not read yet.
    """
    if knots is None:
        raise ValueError("a plan that was not read")
    return knots


def table(context: SectionContext, key: str, count: int, columns: Sequence[int]) -> ca.SX:
    """Symbolic values at the points (count x columns) under a key of a section."""
    rows = [[context.parameters(f"{context.path}.{key}.{k}.{j}") for j in columns] for k in range(count)]
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


class CollocationTimes(Section):
    """Points in time, the same number in each interval between two knots."""

    times: Row = Field(
        min_length=2,
        max_length=MOST_POINTS,
        description="times of the points, rising, the first one 0; where forces jump at knots, each "
        "interval has rows of its own at both ends, two of the same time at each knot [s]",
    )
    points: int = Field(
        default=2,
        ge=2,
        le=8,
        description="points of an interval between two knots, both ends included",
    )

    @model_validator(mode="after")
    def _check(self) -> CollocationTimes:
        if self.times[0] != 0:
            raise ValueError(f"times: must start at 0, found {self.times[0]:g}")
        parted = is_parted(self.times, self.points)
        for k, (a, b) in enumerate(itertools.pairwise(self.times), start=1):
            if b < a if parted and k % self.points == 0 else b <= a:
                raise ValueError("times: must rise strictly")
        nodes_of(np.array(self.times), self.points)
        for key, rows in self:
            if key != "times" and isinstance(rows, tuple) and isinstance(rows[0], tuple):
                if len(rows) != len(self.times):
                    raise ValueError(f"{key}: found {len(rows)} points, and {len(self.times)} times")
                width = self._width()
                for i, row in enumerate(rows):
                    if len(row) != width:
                        raise ValueError(f"{key}.{i}: found {len(row)} numbers, allowed: {width}")
        return self

    def _width(self) -> int:
        return 3


class PhasedPlan(CollocationTimes):
    """Phases of a plan that a robot follows."""

    phases: dict[Name, tuple[float, float]] = quantity(
        "s", "when each phase of the plan begins and ends, by name; one phase if none", default={}
    )

    def time(self, robot: RobotContext) -> ca.SX | None:
        """Time in the plan (1x1) [s]: within the present phase, or after the plan's end in other phases.

        None if the plan uses simulation time.
        """
        phases = robot.context.phases
        if not phases:
            return None
        if not self.phases:
            return robot.phase_time()
        end = self.times[-1]
        after_end = 2 * end
        plan_time = ca.SX(after_end)
        for name, (begin, last) in self.phases.items():
            if name in phases:
                phase_time = robot.phase_time()
                within = begin + (phase_time if last == end else ca.fmin(phase_time, last - begin))
                plan_time = plan_time + phases[name] * (within - after_end)
        return plan_time


class BaseMotion(PhasedPlan):
    """Wrench and motion of a base along some of its own axes, as values at points."""

    axes: tuple[Literal["fx", "fy", "fz", "tx", "ty", "tz"], ...] = Field(
        min_length=1, description="axes of the root link, forces and torques, in the order of each row"
    )
    wrench: tuple[Row, ...] = Field(description="forces and torques at each point [N or N m]")
    rate: tuple[Row, ...] = Field(description="velocity and spin of the root link likewise [m/s or rad/s]")

    def _width(self) -> int:
        return len(self.axes)


class JointMotion(PhasedPlan):
    """Desired motion of joints: values at points, with polynomials in between."""

    joints: tuple[str, ...] = Field(min_length=1, description="names of joints, in the order of each row")
    position: tuple[Row, ...] = Field(description="positions at each point [rad or m]")
    rate: tuple[Row, ...] = Field(description="rates at each point [rad/s or m/s]")
    effort: tuple[Row, ...] | None = Field(
        default=None, description="torques or forces at each point [N m or N]; none if not given"
    )

    def _width(self) -> int:
        return len(self.joints)


class TipMotion(CollocationTimes):
    """Desired motion of a tip, world axes: values at points, with polynomials in between."""

    position: tuple[Vector, ...] = Field(description="at each point [m]")
    velocity: tuple[Vector, ...] = Field(description="at each point [m/s]")
    rotation: tuple[Vector, ...] = Field(description="rotation vector of the tip's axes at each point [rad]")
    spin: tuple[Vector, ...] = Field(description="angular velocity at each point [rad/s]")
