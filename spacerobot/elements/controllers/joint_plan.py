r"""Tracking of a planned motion of the joints.

$$ \tau = f\,\tau_p + K_p\,(\theta_p - \theta) + K_d\,(\dot\theta_p - \dot\theta) $$

with the torque, positions and rates of the plan (index $p$). The base moves freely. After its end the plan
rests at its final positions, without torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from pydantic import Field

from spacerobot.common.section import Name, quantity
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import CommandedTorque, Contribution
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.references.knot_motion import Knots
from spacerobot.elements.references.plan_following import (
    JointMotion,
    PlanFollower,
    known,
    plan_phase,
    table,
)
from spacerobot.elements.sensors.joint_position import read_positions

APART = 1e-3
"""Distance from the plan's start [rad or m] above which the user is warned."""


class JointPlanController(PlanFollower, RobotController):
    """A controller of joints that track a planned motion."""

    phase: Name | None = plan_phase()
    knots: JointMotion | None = Field(
        default=None, description="points of the planned trajectory, if not in a file"
    )
    kp: float = quantity("N m/rad or N/m", "proportional gain", default=0.0, ge=0)
    kd: float = quantity("N m s/rad or N s/m", "derivative gain", default=0.0, ge=0)
    feed_forward: float = quantity("1", "fraction of the planned torque that is commanded", default=1.0, ge=0)

    @classmethod
    def read(cls, file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
        """Motion of the robot's joints."""
        from spacerobot.elements.references.plan_file import read_joints

        return read_joints(file, where, phase)

    def build(self, robot: RobotContext) -> Contribution:
        """Torques."""
        knots = self.among(robot)
        events = () if knots.event is None else (knots.event,)
        return Contribution(torques=(self.joint_torques(robot, knots),), events=events)

    def joint_torques(self, robot: RobotContext, knots: Knots) -> CommandedTorque:
        """Torques of the joints.

        Args:
            robot, knots: The robot, and the present instant among the points of the plan.
        """
        motion, number = self.planned, robot.context.number
        reference = knots.motion("position", self._table(robot, "position"), self._table(robot, "rate"))
        efforts = ca.SX(len(robot.joints), 1)
        if motion.effort is not None:
            efforts = number("feed_forward") * knots.force("effort", self._table(robot, "effort"))
        kp, kd = number("kp"), number("kd")
        speeds = robot.read("joint_rate", robot.plant.v[list(robot.columns)])
        torques = [
            efforts[i] + kp * (reference.value[i] - position) + kd * (reference.rate[i] - speeds[i])
            for i, position in enumerate(read_positions(robot, reference.value))
        ]
        return robot.torque(ca.vertcat(*torques))

    @property
    def begins(self) -> float:
        """Start of the plan relative to its phase [s]."""
        return 0.0

    def among(self, robot: RobotContext) -> Knots:
        """The present instant among the points of the plan."""
        motion = self.planned
        return Knots.at(robot.context, np.array(motion.times), motion.points, motion.time(robot))

    @property
    def planned(self) -> JointMotion:
        """The planned motion, which was given or read."""
        return known(self.knots)

    def _table(self, robot: RobotContext, key: str) -> ca.SX:
        """Values at the points (n x joints), joints in the robot's order."""
        columns = [self.planned.joints.index(name) for name in robot.joint_names]
        return table(robot.context, f"knots.{key}", len(self.planned.times), columns)

    def reads(self) -> set[str]:
        """Joint positions and rates."""
        return {"joint_position", "joint_rate"}

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: joints of the plan that the robot lacks, and joints of the robot that the plan lacks."""
        plan_joints, robot_joints = set(self.planned.joints), set(robot.joints)
        for reason, names in (
            ("no joint", plan_joints - robot_joints),
            ("no motion of joint", robot_joints - plan_joints),
        ):
            if names:
                joint_names = ", ".join(sorted(names))
                yield "knots.joints", f"{reason} {joint_names}; {robot.name} has {', '.join(robot.joints)}"

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """Warning if the plan starts away from the robot's initial positions."""
        motion = self.planned
        if motion.phases or self.phase is not None:
            return
        distances = {
            name: abs(motion.position[0][motion.joints.index(name)] - begin)
            for name, begin in robot.begins.items()
            if name in motion.joints
        }
        name = max(distances, key=lambda joint: distances[joint], default="")
        if name and distances[name] > APART:
            yield f"the plan begins {distances[name]:.4g} rad or m from where {name} begins"

    def words(self) -> str:
        """Gains and plan."""
        plan = f"a plan of {len(self.planned.times)} points over {self.planned.times[-1]:g} s"
        return f"{self.kp:g} / {self.kd:g} along {plan}"
