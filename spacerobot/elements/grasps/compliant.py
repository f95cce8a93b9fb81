"""Spring and damper between tip and mating frame (K_g, R_g)."""

from __future__ import annotations

from typing import Literal

import casadi as ca

from spacerobot.elements.context import GraspContext
from spacerobot.elements.contribution import Contribution, PowerTerm
from spacerobot.elements.grasp import Grasp, observed, only, relative_motion
from spacerobot.elements.registry import register
from spacerobot.section import quantity


@register
class Compliant(Grasp):
    """Spring and damper between tip and mating frame; one pair of opposite wrenches at the tip's point."""

    kind: Literal["compliant"] = "compliant"
    stiffness: float = quantity("N/m", "translational stiffness K_g", default=100.0, ge=0)
    damping: float = quantity("N s/m", "translational damping R_g", default=10.0, ge=0)
    rotational_stiffness: float | None = quantity(
        "N m/rad", "rotational stiffness; none if not given", default=None, ge=0
    )
    rotational_damping: float | None = quantity(
        "N m s/rad", "rotational damping; none if not given", default=None, ge=0
    )

    def build(self, grasp: GraspContext) -> Contribution:
        """Springs and dampers, between the orientations too if asked."""
        plant, number, relative = grasp.plant, grasp.context.number, relative_motion(grasp)
        stiffness, damping = number("stiffness"), number("damping")
        gap = only(relative.gap, plant.translation_axes)
        velocity = only(relative.velocity, plant.translation_axes)
        force = stiffness * gap + damping * velocity
        energy = stiffness * ca.dot(gap, gap) / 2
        taken = damping * ca.dot(velocity, velocity)
        torque = ca.SX(3, 1)
        twist, spin = only(relative.twist, plant.rotation_axes), only(relative.spin, plant.rotation_axes)
        if self.rotational_stiffness is not None:
            rotational = number("rotational_stiffness")
            torque = torque + rotational * twist
            energy = energy + rotational * ca.dot(twist, twist) / 2
        if self.rotational_damping is not None:
            rotational = number("rotational_damping")
            torque = torque + rotational * spin
            taken = taken + rotational * ca.dot(spin, spin)
        return Contribution(
            wrenches=grasp.opposite(force, torque),
            energy=energy,
            powers=(PowerTerm("grasp", taken), *relative.rest.powers(force, torque)),
            outputs=observed(grasp, relative, force, torque),
        )

    def assumptions(self) -> list[str]:
        """How it acts, and where its springs are at rest."""
        found = ["one pair of opposite forces at the tip's point"]
        if self.rotational_stiffness and self.begins == "closed":
            found.append("rotational spring at rest in the initial relative orientation")
        return found

    def words(self) -> str:
        """Its stiffness and damping."""
        return f"compliant {self.stiffness:g} N/m, {self.damping:g} N s/m"
