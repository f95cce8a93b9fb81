"""Elements that hold what Basilisk's messages command until its next step."""

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
    """Torques of joints and a wrench on the base, root link's axes, that messages of Basilisk command."""

    kind: Literal["basilisk_commands"] = "basilisk_commands"
    parts: tuple[Part, ...] = Field(default=(), description="parts of the wrench that actuators deliver")

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the wrench, by its section."""
        return frozenset(self.parts)

    def build(self, robot: RobotContext) -> Contribution:
        """Held commands: those of the joints, then force [N] and torque [N m] on the base."""
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
        """The source of its commands."""
        return "commands of Basilisk's messages"


@register
class BasiliskForces(Environment):
    """Forces and torques on everything that moves, from Basilisk's gravity and dynamic effectors."""

    kind: Literal["basilisk_forces"] = "basilisk_forces"
    falls: ClassVar[bool] = True

    def build(self, environment: EnvironmentContext) -> Contribution:
        """Held force [N] at the centre of mass of each load, and torque [N m], world axes."""
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
        """Location of the world frame."""
        return ["the world's origin falls in Basilisk's gravity; its axes are those of the frame N"]

    def words(self) -> str:
        """The source of its forces."""
        return "gravity and dynamic effectors of Basilisk"
