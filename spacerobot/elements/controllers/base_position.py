"""Position control of a floating base; see :mod:`spacerobot.elements.controllers.base_control`."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics import centre_of_mass, momentum, subtree, total_mass
from spacerobot.dynamics.algebra import cross_columns
from spacerobot.elements.controllers.base_control import ArmReaction, BaseMotionController, held, resistance
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part


@register
class BasePosition(BaseMotionController):
    """PID on the base's position, with feed-forward of the arm's reaction; actuators of the base deliver it.

    The force is commanded at the robot's centre of mass, where it exerts no torque on the robot. Without K_p
    and K_i it brings the base to rest at any position.
    """

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    kind: Literal["base_position"] = "base_position"
    kp: float = quantity("N/m", "proportional gain K_p", default=0.0, ge=0)
    ki: float = quantity("N/(m s)", "integral gain K_i", default=0.0, ge=0)
    kd: float = quantity("N s/m", "rate gain K_d", default=0.0, ge=0)
    position: Vector | None = quantity(
        "m", "of the root link, world axes, to be held; that of the start if not given", default=None
    )

    def build(self, robot: RobotContext) -> Contribution:
        """Contribution: force on the base against its position error."""
        plant, context = robot.plant, robot.context
        base_position = plant.placement(robot.base_frame)[1]
        if self.position is None:
            reference = context.once("position", robot.start.placement(robot.base_frame)[1])
        else:
            reference = context.vector("position")
        bodies = subtree(plant.model, robot.base_joint)
        lever = centre_of_mass(plant.model, plant.kinematics, plant.inertias, bodies) - base_position
        jacobian = plant.jacobian(robot.base_frame)
        actuation = jacobian[:3, :] - cross_columns(lever, jacobian[3:, :])
        # the point at the lever moves with v + omega x lever
        reaction = None if context.is_zero("feed_forward") else self._reaction(robot, jacobian[:3, :].T)
        error = reference - robot.read("base_position", base_position)
        return held(robot, "translation", error, ca.sparsify(actuation).T, reaction)

    def _reaction(self, robot: RobotContext, moving: ca.SX) -> ArmReaction:
        """Rate of the robot's linear momentum, minus that of the base's own motion."""
        plant, joints = robot.plant, subtree(robot.plant.model, robot.base_joint)
        mass = total_mass(plant.model, plant.inertias, joints)
        if self.derivative == "filtered":
            linear_momentum = momentum(plant.model, plant.kinematics, plant.inertias, joints)[0]
            return ArmReaction(
                None, ca.SX(3, 1), linear_momentum - mass * plant.velocity(robot.base_frame)[0]
            )
        along = ca.vertcat(ca.SX.eye(3), ca.SX(3, 3))
        sense = resistance(robot, along) - plant.reduced(mass * moving)
        drift = plant.inertia_force(joints)[0] - mass * plant.drift(robot.base_frame)[0]
        return ArmReaction(sense, drift)

    def reads(self) -> set[str]:
        """Position and velocity."""
        return {"base_position", "base_velocity"}
