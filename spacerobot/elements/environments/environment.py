"""Environments: external influences on all moving bodies of a scene."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from spacerobot.common.registry import required
from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.core.contribution import Contribution, PowerTerm
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class Load:
    """Rigid load of one joint: the links welded to it; world axes.

    Attributes:
        joint: Id of the joint.
        mass, com: Mass (1x1) [kg], and position of its centre of mass (3x1) [m].
        rotation: Rotation from its own axes to world axes (3x3).
        inertia: Inertia about its centre of mass, its own axes (3x3) [kg m^2].
        velocity, spin: Velocity of its centre of mass [m/s], and angular velocity [rad/s] (3x1 each).
    """

    joint: int
    mass: ca.SX
    com: ca.SX
    rotation: ca.SX
    inertia: ca.SX
    velocity: ca.SX
    spin: ca.SX


@dataclass(frozen=True)
class EnvironmentContext:
    """View of a scene for its environments; everything in world axes.

    Attributes:
        context: Time and the numbers of the environment's section.
        plant: Mechanics at the present state.
        roots: Frames of the bodies' root links, by the bodies' names.
    """

    context: SectionContext
    plant: Plant
    roots: dict[str, int]

    @functools.cached_property
    def loads(self) -> tuple[Load, ...]:
        """Everything that moves and has mass."""
        inertias, kinematics = self.plant.inertias, self.plant.kinematics
        moving_loads = []
        for joint in (j for j in range(1, len(inertias.mass)) if inertias.mass[j].nnz()):
            mass, moment = inertias.mass[joint], inertias.moment[joint]
            centre, about_origin = moment / mass, inertias.rotational[joint]
            steiner = ca.dot(moment, centre) * ca.SX.eye(3) - ca.mtimes(moment, centre.T)
            constants = self.context.constants
            central = self.context.once(f"inertia.{joint}", constants.expanded(about_origin - steiner))
            rotation, spin = kinematics.rotation[joint], kinematics.angular_velocity[joint]
            lever = ca.mtimes(rotation, self.context.once(f"com.{joint}", constants.expanded(centre)))
            velocity = kinematics.linear_velocity[joint] + cross(spin, lever)
            place = kinematics.origin[joint] + lever
            moving_loads.append(Load(joint, mass, place, rotation, central, velocity, spin))
        return tuple(moving_loads)

    def acting(self, load: Load, force: ca.SX, torque: ca.SX) -> tuple[Wrench, PowerTerm]:
        """Wrench on a load at its centre of mass, and its power.

        In a planar scene the components out of the plane are dropped.

        Args:
            load: Load of one joint.
            force, torque: Force [N] and torque [N m], world axes (3x1 each).
        """
        force, torque = ca.SX(force), ca.SX(torque)
        if self.plant.planar:
            force[2], torque[:2] = 0, 0
        force, torque = ca.sparsify(force), ca.sparsify(torque)
        power = ca.dot(force, load.velocity) + ca.dot(torque, load.spin)
        return Wrench(load.joint, force, torque, load.com), PowerTerm("environment", power, "in")


class Environment(Element):
    """External influence on all bodies alike, without knowledge of arms and bases.

    Attributes:
        falls: Whether the world's origin is in free fall with it, which excludes uniform gravity and a second
            such environment.
    """

    family: ClassVar[str] = "environment"
    falls: ClassVar[bool] = False

    @required()
    def build(self, environment: EnvironmentContext) -> Contribution:
        """Contribution to the closed loop: external wrenches, works, outputs."""
        raise NotImplementedError

    def mean_motion(self) -> float | None:
        """Mean motion [rad/s] if it is a circular orbit; None where bodies do not drift by a closed form."""
        return None
