r"""Impedance of a tip's translation or rotation, with a base that reacts.

$$ f = A \left( K A^\top (x_\text{ref} - x) + D A^\top (\dot x_\text{ref} - \dot x) \right), \qquad
   \tau = J^{*\top} f, \qquad J^* = J_m - J_b H_b^{-1} H_{bm} $$

with diagonal stiffness $K$ and damping $D$ along the axes $A$ of the world or of the reference (Hogan 1985),
and the generalized Jacobian $J^*$ (Umetani and Yoshida 1989); of a fixed base $J^* = J_m$. The inertia at the
tip remains the arm's own: $f$ accelerates the tip as $\Lambda^* = (J^* H^{*-1} J^{*\top})^{-1}$, with the
inertia $H^*$ of the joints with the base's reaction.

A desired inertia $M$ takes the measured wrench $\hat f$ on the tip (Hogan 1985; Siciliano and Villani 1999):

$$ M_A (\ddot x - \ddot x_\text{ref}) = K_A (x_\text{ref} - x) + D_A (\dot x_\text{ref} - \dot x) + \hat f,
   \qquad u = \Lambda^* (\ddot x - \gamma - W \hat f), \qquad \tau = J^{*\top} u, $$

with $M_A = A M A^\top$ and the acceleration $\gamma + W \hat f$ of the tip without torques; the wrench also
accelerates the base, which is in $W$ (:mod:`spacerobot.elements.controllers.operational_space`). The rotation
takes the angular acceleration and the couple about the tip's origin.

The couple of the rotation follows from the rotation vector $\varphi$ from the tip to its reference:

$$ n = J_l^{-1}(\varphi)\, K_A\, \varphi + D_A\, (\omega_\text{ref} - \omega), \qquad
   J_l^{-1}(\varphi)\, u = u - \tfrac{1}{2} \varphi \times u
   + \frac{1 - \frac{\theta}{2} \cot \frac{\theta}{2}}{\theta^2}\, \varphi \times (\varphi \times u), $$

where $K_A = A K A^\top$, $D_A = A D A^\top$ and $\theta = |\varphi|$. Its first part is the negative gradient
of $\frac{1}{2} \varphi^\top K_A \varphi$.

**Passivity.** Without momentum and external forces $\dot x = J^* \dot q$. For a reference at rest the energy

$$ V = T + \tfrac{1}{2} (x_\text{ref} - x)^\top K_A (x_\text{ref} - x), \qquad
   \dot V = -\dot x^\top D_A\, \dot x - \dot q^\top B \dot q \le 0, $$

with the kinetic energy $T$ and the joints' damping $B$, never grows. With the manipulator Jacobian $J_m$ this
does not hold: its power is that of the tip's velocity relative to the base.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca

from spacerobot.common.section import quantity
from spacerobot.dynamics.rotations import inverse_left_jacobian
from spacerobot.elements.controllers.compliance import (
    ImpedanceLaw,
    PositiveGains,
    gains_of,
    listed,
    read_pose_error,
    read_rate_error,
    reference_acceleration,
)
from spacerobot.elements.controllers.operational_space import accelerating
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import Contribution, ControlChannel
from spacerobot.elements.core.registry import register


@register
class Impedance(ImpedanceLaw):
    """Cartesian stiffness and damping between a tip and its reference, by the generalized Jacobian.

    Under a name that begins with ``orientation`` it controls the tip's rotation.
    """

    kind: Literal["impedance"] = "impedance"
    inertia: PositiveGains | None = quantity(
        "kg",
        "desired inertia along each of the axes, which needs the measured wrench on the tip; that of the "
        "arm if not given",
        rotation="kg m^2",
        default=None,
    )

    def build(self, tip: TipContext) -> Contribution:
        """Channel of a force or couple on the tip, or of the torques that shape its inertia."""
        turns = self.controls(tip.key) == "rotation"
        stiffness, damping = (gains_of(tip, key, self.axes) for key in ("stiffness", "damping"))
        error = read_pose_error(tip, turns=turns)
        spring = ca.mtimes(stiffness, error)
        if turns and len(tip.plant.rotation_axes) == 3:
            spring = inverse_left_jacobian(error, spring)
        load = spring + ca.mtimes(damping, read_rate_error(tip, turns=turns))
        if self.inertia is not None:
            wrench = tip.measured_wrench()
            load = load + wrench[3 * turns : 3 * turns + 3]
            shaped = ca.mtimes(gains_of(tip, "inertia", self.axes, inverse=True), load)
            desired = reference_acceleration(tip, turns=turns) + shaped
            return Contribution(channels=(accelerating(tip, self.controls(tip.key), desired, wrench),))
        axes = list(tip.plant.rotation_axes if turns else tip.plant.translation_axes)
        actuation = tip.generalized_jacobian[[axis + 3 * turns for axis in axes], :].T
        _, sense = tip.reduced_loads(axes, rotation=turns)
        drive = tip.plant.reduced(actuation)
        return Contribution(channels=(ControlChannel(tip.robot, actuation, drive, sense, load[axes], None),))

    @property
    def reads_wrench(self) -> bool:
        """Whether it has a desired inertia, which needs the measured wrench."""
        return self.inertia is not None

    def assumptions(self) -> list[str]:
        """Effects that its Jacobian neglects."""
        shaping = "without inertia shaping" if self.inertia is None else "with inertia shaping by its model"
        return [f"impedance {shaping}; knows the robot's inertia, not that of a held object"]

    def words(self) -> str:
        """Stiffness and damping, in text form."""
        text = f"impedance {listed(self.stiffness, self.damping)}"
        return text if self.inertia is None else f"{text}, inertia {listed(self.inertia)}"
