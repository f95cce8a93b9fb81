"""Model predictive control: the plan is recomputed from measurements in each period; the joints track it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from spacerobot.elements.context import RobotContext
from spacerobot.elements.contribution import Contribution
from spacerobot.elements.controller import Replanning
from spacerobot.elements.joint_plan import JointPlanController
from spacerobot.elements.knot_motion import Knots
from spacerobot.elements.registry import register
from spacerobot.elements.robot_element import RobotProperties
from spacerobot.errors import ScenarioError
from spacerobot.section import quantity


@register
class Mpc(JointPlanController):
    """Joints track a plan that is recomputed in each period for the remaining time (MPC)."""

    kind: Literal["mpc"] = "mpc"
    file: None = Field(default=None, description="none: plans are made in flight")
    phase: None = Field(default=None, description="none: plans are of one phase")
    period: float = quantity("s", "time between two plans", default=0.5, gt=0)
    min_horizon: float = quantity(
        "s", "time that a plan looks ahead at least; the last one before the end is kept", default=1.0, gt=0
    )
    delay: float = quantity(
        "s", "time from what is sensed to the plan that is made from it being flown", default=0.0, ge=0
    )
    iterations: int = Field(default=60, ge=1, description="of the solver, at most, for a plan in flight")
    begin: float = quantity("s", "when the plan in `knots` begins", default=0.0, ge=0)

    @model_validator(mode="after")
    def _check(self) -> Mpc:
        """Knots come between the periods; one plan is made before the next one is begun."""
        if self.delay > self.period:
            raise ValueError(f"delay: found {self.delay:g} s, allowed: at most the period, {self.period:g} s")
        return self

    @property
    def replanning(self) -> Replanning:
        """Once in each period."""
        return Replanning(self.period, self.min_horizon, self.delay, self.iterations)

    def build(self, robot: RobotContext) -> Contribution:
        """Torques; the plan is that of the present period.

        Raises
        ------
        ScenarioError
            If there is none.
        """
        if self.knots is None:
            raise ScenarioError(
                "kind mpc replans between the periods of one rollout, as `spacerobot run` does; "
                "campaigns, searches and other engines do not: there, follow a plan by joint_tracking",
                where=robot.context.path,
            )
        return super().build(robot)

    def among(self, robot: RobotContext) -> Knots:
        """The present instant among the points of the plan."""
        motion, begin = self.planned, robot.context.number("begin")
        return Knots.at(robot.context, np.array(motion.times), motion.points, begin=begin)

    @property
    def begins(self) -> float:
        """When the plan begins [s]."""
        return self.begin

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Joints that are not the robot's, where there is a plan."""
        return () if self.knots is None else super().faults(robot)

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """None: each plan begins where the robot is."""
        del robot
        return ()

    def reads(self) -> set[str]:
        """Joints, and what is known of the base and the target where a plan is made."""
        seen = ("position", "velocity", "orientation", "spin")
        return super().reads() | {f"{what}_{signal}" for what in ("target", "base") for signal in seen}

    def words(self) -> str:
        """Its gains and its period."""
        return f"{self.kp:g} / {self.kd:g} along plans recomputed every {self.period:g} s"
