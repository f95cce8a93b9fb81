r"""Admittance of a tip's translation or rotation: a measured wrench moves its reference.

A virtual mass, damper and spring between the reference and a compliant frame turn the measured wrench
$\hat f$ on the tip into a displacement $z$ (Seraji 1994; Ott, Mukherjee and Nakamura 2010):

$$ M_A \ddot z + D_A \dot z + K_A z = \hat f, \qquad x_c = x_\text{ref} + z. $$

An inner loop with the bandwidth $\omega$ makes the tip follow the compliant frame,

$$ a = \ddot x_c + 2 \omega (\dot x_c - \dot x) + \omega^2 (x_c - x), \qquad
   u = \Lambda^* (a - \gamma - W \hat f), \qquad \tau = J^{*\top} u, $$

with a base that reacts (:mod:`spacerobot.elements.controllers.operational_space`). Errors of its model, such
as friction, act against the stiffness of the inner loop, not against $K$.

Of the rotation, $z$ is the rotation vector from the reference to the compliant frame, world axes, with
$\omega_c = J_l(z)\, \dot z + e^{[z]} \omega_\text{ref}$ and the left Jacobian $J_l$ of SO(3); its angular
acceleration is taken as $\ddot z + \alpha_\text{ref}$.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca

from spacerobot.common.section import quantity
from spacerobot.dynamics.rotations import left_jacobian, rotation_exp, rotation_log
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
from spacerobot.elements.core.contribution import Contribution, State
from spacerobot.elements.core.registry import register


@register
class Admittance(ImpedanceLaw):
    """Motion of a tip that yields to the measured wrench as a virtual mass, damper and spring.

    Under a name that begins with ``orientation`` it controls the tip's rotation.
    """

    kind: Literal["admittance"] = "admittance"
    inertia: PositiveGains = quantity(
        "kg", "virtual inertia along each of the axes", rotation="kg m^2", default=(1.0, 1.0, 1.0)
    )
    bandwidth: float = quantity(
        "rad/s", "of the inner loop that makes the tip follow, critically damped", default=10.0, gt=0
    )

    def build(self, tip: TipContext) -> Contribution:
        """Channel of the inner loop, and the states of the compliant frame."""
        turns, plant = self.controls(tip.key) == "rotation", tip.plant
        axes = list(plant.rotation_axes if turns else plant.translation_axes)
        wrench = tip.measured_wrench()
        stiffness, damping = (gains_of(tip, key, self.axes) for key in ("stiffness", "damping"))
        mobility = gains_of(tip, "inertia", self.axes, inverse=True)
        name, none = f"{tip.label}/{tip.key}", ca.SX.zeros(len(axes))
        offset_symbol = ca.SX.sym(f"{name}.offset", len(axes))
        rate_symbol = ca.SX.sym(f"{name}.rate", len(axes))
        offset, rate = ca.SX(3, 1), ca.SX(3, 1)
        offset[axes], rate[axes] = offset_symbol, rate_symbol
        load = wrench[3 * turns : 3 * turns + 3] - ca.mtimes(damping, rate) - ca.mtimes(stiffness, offset)
        acceleration = ca.mtimes(mobility, load)
        error, error_rate = read_pose_error(tip, turns=turns), read_rate_error(tip, turns=turns)
        if turns and len(axes) == 3:
            compliant = rotation_exp(offset)
            spin = tip.motion.angular_velocity
            error_rate = error_rate + left_jacobian(offset, rate) + ca.mtimes(compliant, spin) - spin
            error = rotation_log(ca.mtimes(compliant, rotation_exp(error)))
        else:
            error, error_rate = error + offset, error_rate + rate
        bandwidth = tip.context.number("bandwidth")
        desired = (
            reference_acceleration(tip, turns=turns)
            + acceleration
            + 2 * bandwidth * error_rate
            + bandwidth**2 * error
        )
        states = (
            State(f"{name}.offset", offset_symbol, none, rate_symbol),
            State(f"{name}.rate", rate_symbol, none, acceleration[axes]),
        )
        channel = accelerating(tip, self.controls(tip.key), desired, wrench)
        return Contribution(states=states, channels=(channel,))

    def assumptions(self) -> list[str]:
        """Effects that its model neglects."""
        return ["admittance by the robot's model; knows the robot's inertia, not that of a held object"]

    def words(self) -> str:
        """Virtual inertia, damping, stiffness and bandwidth, in text form."""
        return f"admittance {listed(self.inertia, self.damping, self.stiffness)}, {self.bandwidth:g} rad/s"
