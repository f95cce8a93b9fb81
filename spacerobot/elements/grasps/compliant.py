"""Spring and damper between tip and mating frame (K_g, R_g)."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Literal

import casadi as ca

from spacerobot.common.section import quantity
from spacerobot.elements.core.context import GraspContext
from spacerobot.elements.core.contribution import Contribution, PowerTerm
from spacerobot.elements.core.registry import register
from spacerobot.elements.grasps.grasp import Displacement, Grasp, observed, only, relative_motion


@register
class Compliant(Grasp):
    """Spring and damper between tip and mating frame; one pair of opposite wrenches at the tip's point."""

    has_springs: ClassVar[bool] = True

    kind: Literal["compliant"] = "compliant"
    stiffness: float = quantity("N/m", "translational stiffness K_g", default=100.0, ge=0)
    damping: float = quantity("N s/m", "translational damping R_g", default=10.0, ge=0)
    rotational_stiffness: float | None = quantity(
        "N m/rad", "rotational stiffness; none if not given", default=None, ge=0
    )
    rotational_damping: float | None = quantity(
        "N m s/rad", "rotational damping; none if not given", default=None, ge=0
    )

    @property
    def holds_orientation(self) -> bool:
        """Whether the grasp has rotational springs or dampers."""
        return bool(self.rotational_stiffness or self.rotational_damping)

    def spring_wrench(self, number: Callable[[str], ca.SX], tip: Displacement) -> tuple[ca.SX, ca.SX]:
        """Force ``K_g gap + R_g velocity`` and, if configured, the corresponding torque."""
        force = number("stiffness") * tip.gap + number("damping") * tip.velocity
        torque = ca.SX(3, 1)
        if self.rotational_stiffness is not None:
            torque = torque + number("rotational_stiffness") * tip.twist
        if self.rotational_damping is not None:
            torque = torque + number("rotational_damping") * tip.spin
        return force, torque

    def build(self, grasp: GraspContext) -> Contribution:
        """Springs and dampers, the energy that they store and the power that they take."""
        plant, number, relative = grasp.plant, grasp.context.number, relative_motion(grasp)
        gap = only(relative.gap, plant.translation_axes)
        velocity = only(relative.velocity, plant.translation_axes)
        twist, spin = only(relative.twist, plant.rotation_axes), only(relative.spin, plant.rotation_axes)
        force, torque = self.spring_wrench(number, Displacement(gap, twist, velocity, spin))
        energy = number("stiffness") * ca.dot(gap, gap) / 2
        dissipated = number("damping") * ca.dot(velocity, velocity)
        if self.rotational_stiffness is not None:
            energy = energy + number("rotational_stiffness") * ca.dot(twist, twist) / 2
        if self.rotational_damping is not None:
            dissipated = dissipated + number("rotational_damping") * ca.dot(spin, spin)
        return Contribution(
            wrenches=grasp.opposite(force, torque),
            energy=energy,
            powers=(PowerTerm("grasp", dissipated), *relative.rest.powers(force, torque)),
            outputs=observed(grasp, relative, force, torque),
        )

    def assumptions(self) -> list[str]:
        """Assumptions: action point of the forces, and the pose at which the springs are at rest."""
        sentences = ["one pair of opposite forces at the tip's point"]
        if self.rotational_stiffness and self.begins == "closed":
            sentences.append("rotational spring at rest in the initial relative orientation")
        return sentences

    def words(self) -> str:
        """Stiffness and damping."""
        return f"compliant {self.stiffness:g} N/m, {self.damping:g} N s/m"
