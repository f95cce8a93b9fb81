r"""A controller of one's own: a spring of bounded force from a tip to its reference, with a damper.

spacerobot run paper --plugin bounded_spring.py \
  --set 'robots.*.tips.tip.controllers={s: {kind: bounded_spring}}'
"""

from typing import Literal

import casadi as ca

import spacerobot as sr
from spacerobot.elements import Contribution, Output, TipContext, TipController, quantity


@sr.register
class BoundedSpring(TipController):
    """Spring whose force saturates, and a damper, between a tip and its reference."""

    kind: Literal["bounded_spring"] = "bounded_spring"
    stiffness: float = quantity("N/m", "stiffness K at small errors", default=500.0, ge=0)
    damping: float = quantity("N s/m", "damping D", default=200.0, ge=0)
    bound: float = quantity("N", "bound of the spring's force along each axis", default=20.0, gt=0)

    def build(self, tip: TipContext) -> Contribution:
        """Joint torques ``J^T F``, and the force as an output of the tip."""
        stiffness, damping, bound = (tip.context.number(key) for key in ("stiffness", "damping", "bound"))
        spring = bound * ca.tanh(stiffness * (tip.motion.position - tip.position) / bound)
        force = spring + damping * (tip.motion.velocity - tip.velocity)
        text = "force of tips' bounded springs"
        output = Output("spring_force", ca.densify(force), "N", text, "tip", tip.label)
        return Contribution(torques=(tip.torque(force),), outputs=(output,))
