"""Rigid grasps: acceleration constraints and their constraint wrenches."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.core.context import GraspContext, unit_load
from spacerobot.elements.core.contribution import AccelerationConstraint, Contribution, PowerTerm
from spacerobot.elements.grasps.grasp import Grasp, apart, observed, relative_motion


class RigidGrasp(Grasp):
    """A grasp without play; its drift is stabilised (Baumgarte, critically damped)."""

    fixes_position: ClassVar[bool] = True

    max_gap: float = quantity(
        "m",
        "maximum distance of tip and mating frame at the start, where no base moves to close it",
        default=1e-6,
        ge=0,
    )
    stabilisation: float = quantity(
        "1/s", "rate at which drift of the constraint decays (critically damped)", default=20.0, ge=0
    )

    def build(self, grasp: GraspContext) -> Contribution:
        """Acceleration constraint, of exactly the rank that the grasp has."""
        plant, relative = grasp.plant, relative_motion(grasp)
        rate = grasp.context.number("stabilisation")
        # relative acceleration at zero joint acceleration, linear and angular (3x1 each)
        tip_drift, mate_drift = plant.drift(grasp.tip_frame), plant.drift(grasp.mate_frame)
        tip_velocity, mate = plant.velocity(grasp.tip_frame)[0], plant.velocity(grasp.mate_frame)
        linear = tip_drift[0] - mate_drift[0] - cross(mate_drift[1], apart(grasp)[0])
        linear = linear - cross(mate[1], tip_velocity - mate[0]) - relative.rest.acceleration
        angular = tip_drift[1] - mate_drift[1] - relative.rest.angular_acceleration
        along = list(plant.translation_axes)
        drift = [(linear + 2 * rate * relative.velocity + rate**2 * relative.gap)[along]]
        directions = [unit_load(axis, rotation=False) for axis in along]
        slip = [relative.velocity[along]]
        if self.fixes_orientation:
            about = list(plant.rotation_axes)
            drift.append((angular + 2 * rate * relative.spin + rate**2 * relative.twist)[about])
            slip.append(relative.spin[about])
            directions += [unit_load(axis, rotation=True) for axis in about]
        force, torque = (ca.horzcat(*units) for units in zip(*directions, strict=True))
        sense, slips = plant.reduced(wrenches=grasp.opposite(-force, -torque)), ca.vertcat(*slip)

        def answer(force: ca.SX, torque: ca.SX) -> Contribution:
            power = -ca.dot(force, relative.velocity) - ca.dot(torque, relative.spin)
            return Contribution(
                powers=(PowerTerm("constraint", power, "in"), *relative.rest.powers(force, torque)),
                outputs=observed(grasp, relative, force, torque),
            )

        constraint = AccelerationConstraint(tuple(directions), sense, ca.vertcat(*drift), slips, answer)
        return Contribution(constraints=(constraint,))
