"""A controller of one's own: Cartesian impedance of a tip towards its reference.

spacerobot run paper --plugin impedance.py --set 'robots.*.tips.tip.controllers={soft: {kind: impedance}}'
"""

from typing import Literal

import casadi as ca

import spacerobot as sr
from spacerobot.elements import Contribution, Output, TipContext, TipController, quantity


@sr.register
class Impedance(TipController):
    """Spring and damper between a tip and its reference, pressed by the arm's joints."""

    kind: Literal["impedance"] = "impedance"
    stiffness: float = quantity("N/m", "stiffness K", default=500.0, ge=0)
    damping: float = quantity("N s/m", "damping D", default=200.0, ge=0)

    def build(self, tip: TipContext) -> Contribution:
        """Joint torques ``J^T F``, and the force as an output of the tip."""
        stiffness, damping = tip.context.number("stiffness"), tip.context.number("damping")
        spring = stiffness * (tip.motion.position - tip.position)
        force = spring + damping * (tip.motion.velocity - tip.velocity)
        text = "force of tips' impedance controllers"
        output = Output("impedance_force", ca.densify(force), "N", text, "tip", tip.label)
        return Contribution(torques=(tip.torque(force),), outputs=(output,))
