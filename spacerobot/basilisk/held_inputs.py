"""Elements that hold the commands and forces of Basilisk's messages until Basilisk's next step."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.elements import Contribution, RobotContext, register
from spacerobot.elements.controllers.controller import RobotController
from spacerobot.elements.core.contribution import CommandedTorque, memory
from spacerobot.elements.core.robot_element import Part
from spacerobot.elements.environments.environment import Environment, EnvironmentContext

KEY = "basilisk"
"""Key of both elements in their sections."""


@register
class BasiliskCommands(RobotController):
    """Joint torques, and a wrench on the base in the root link's axes, commanded by Basilisk's messages."""

    kind: Literal["basilisk_commands"] = "basilisk_commands"
    parts: tuple[Part, ...] = Field(default=(), description="parts of the wrench that actuators deliver")

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the wrench on the base that the section names."""
        return frozenset(self.parts)

    def build(self, robot: RobotContext) -> Contribution:
        """Held commands as states: joint torques [N m], then force [N] and torque [N m] on the base."""
        joints = len(robot.joint_names)
        held = memory(f"{robot.name}/{robot.key}.held", ca.SX.zeros(joints + 6))
        torque = robot.torque(held.symbol[:joints]).value
        if self.parts:
            rotation, wrench = robot.plant.placement(robot.base_frame)[0], ca.SX(6, 1)
            for part, first in (("force", 0), ("torque", 3)):
                if part in self.parts:
                    rows = held.symbol[joints + first : joints + first + 3]
                    wrench[first : first + 3] = ca.mtimes(rotation, rows)
            torque += ca.mtimes(robot.plant.jacobian(robot.base_frame).T, ca.sparsify(wrench))
        return Contribution(states=(held,), torques=(CommandedTorque(robot.name, torque),))

    def words(self) -> str:
        """Short description: the source of the commands."""
        return "commands of Basilisk's messages"


@register
class BasiliskForces(Environment):
    """Forces and torques of Basilisk's gravity and dynamic effectors on all moving bodies."""

    kind: Literal["basilisk_forces"] = "basilisk_forces"
    falls: ClassVar[bool] = True

    def build(self, environment: EnvironmentContext) -> Contribution:
        """Held force at the centre of mass [N] and torque [N m] of each load as states, world axes."""
        names, path = environment.plant.model.names, environment.context.path
        states, pairs = [], []
        for load in environment.loads:
            held = memory(f"{path}.{names[load.joint]}.held", ca.SX.zeros(6))
            states.append(held)
            pairs.append(environment.acting(load, held.symbol[:3], held.symbol[3:]))
        return Contribution(
            states=tuple(states),
            outside=tuple(wrench for wrench, _ in pairs),
            powers=tuple(power for _, power in pairs),
        )

    def assumptions(self) -> list[str]:
        """Assumption about the world frame."""
        return ["the world's origin falls in Basilisk's gravity; its axes are those of the frame N"]

    def words(self) -> str:
        """Source of the forces."""
        return "gravity and dynamic effectors of Basilisk"
