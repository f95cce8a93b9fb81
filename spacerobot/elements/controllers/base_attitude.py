"""Attitude control of a floating base; see :mod:`spacerobot.elements.controllers.base_control`."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics import FreeFloating, centre_of_mass, momentum, subtree, total_mass
from spacerobot.dynamics.algebra import cross, cross_columns
from spacerobot.dynamics.rotations import rotation_exp, rotation_from_rpy
from spacerobot.elements.controllers.base_control import ArmReaction, BaseMotionController, held, resistance
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part
from spacerobot.elements.references.reference import DEGREE


@register
class BaseAttitude(BaseMotionController):
    """PID on the base's attitude, with feed-forward of the arm's reaction; actuators of the base deliver it.

    Without K_p and K_i it brings the base to rest at any attitude.
    """

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"torque"})

    kind: Literal["base_attitude"] = "base_attitude"
    kp: float = quantity("N m/rad", "proportional gain K_p", default=0.0, ge=0)
    ki: float = quantity("N m/(rad s)", "integral gain K_i", default=0.0, ge=0)
    kd: float = quantity("N m s/rad", "rate gain K_d", default=0.0, ge=0)
    attitude_deg: Vector | None = quantity(
        "deg", "roll, pitch, yaw to be held; those of the start if not given", default=None
    )

    def build(self, robot: RobotContext) -> Contribution:
        """Contribution: torque on the base against its attitude error."""
        plant, context = robot.plant, robot.context
        rotation, start = plant.placement(robot.base_frame)[0], robot.start.placement(robot.base_frame)[0]
        # the signal is the base's rotation since the start
        if self.attitude_deg is None:
            error = plant.orientation_error(context.once("attitude", start), rotation)
            error = -robot.read("base_orientation", -error)
        else:
            angles = context.parameters.sparse_vector(f"{context.path}.attitude_deg") * DEGREE
            reference, first = (
                context.once("attitude", rotation_from_rpy(angles)),
                context.once("start", start),
            )
            rotation_vector = plant.orientation_error(rotation, first)
            reading = robot.read("base_orientation", rotation_vector)
            if not ca.is_equal(reading, rotation_vector):
                rotation = ca.mtimes(rotation_exp(reading), first)
            error = plant.orientation_error(reference, rotation)
        torque_map = plant.jacobian(robot.base_frame)[3:, :].T
        reaction = None if context.is_zero("feed_forward") else self._reaction(robot, torque_map)
        return held(robot, "rotation", error, torque_map, reaction)

    def _reaction(self, robot: RobotContext, torque_map: ca.SX) -> ArmReaction:
        """Rate of the angular momentum about the centre of mass, minus that of the base's own rotation."""
        plant, joints = robot.plant, subtree(robot.plant.model, robot.base_joint)
        rotation, origin = plant.placement(robot.base_frame)
        centre = centre_of_mass(plant.model, plant.kinematics, plant.inertias, joints)
        # inertia of the robot about its initial centre of mass (3x3), base axes; computed once
        split = FreeFloating.split(plant.model, robot.start.kinematics, plant.inertias, robot.base_joint)
        linear = split.base_inertia.size1() - (3 if split.base_inertia.size1() == 6 else 1)
        inertia, coupling = split.base_inertia[linear:, linear:], split.base_inertia[:linear, linear:]
        central = inertia - ca.mtimes(coupling.T, coupling) / total_mass(plant.model, plant.inertias, joints)
        inertia = ca.SX(3, 3)
        inertia[3 - central.size1() :, 3 - central.size1() :] = central
        inertia = robot.context.once("inertia", ca.sparsify(robot.context.constants.expanded(inertia)))
        inertia_world = ca.mtimes(rotation, ca.mtimes(inertia, rotation.T))
        if self.derivative == "filtered":
            spin = plant.velocity(robot.base_frame)[1]
            carried = ca.mtimes(inertia_world, spin)
            angular_momentum = momentum(plant.model, plant.kinematics, plant.inertias, joints, centre)[1]
            return ArmReaction(None, cross(spin, carried), angular_momentum - carried)
        lever = centre - origin
        force, torque = plant.inertia_force(joints)
        about_centre = ca.vertcat(cross_columns(lever, ca.SX.eye(3)), ca.SX.eye(3))
        sense = resistance(robot, about_centre) - plant.reduced(ca.mtimes(torque_map, inertia_world))
        return ArmReaction(sense, torque - cross(lever, force))

    def reads(self) -> set[str]:
        """Attitude and spin."""
        return {"base_orientation", "base_spin"}
