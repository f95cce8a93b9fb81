"""A reference of one's own: a lemniscate (figure of eight), flown by Eq. 42's blend.

spacerobot run paper --plugin lemniscate.py --set 'robots.*.tips.tip.reference={kind: lemniscate}'
"""

from typing import Literal

import casadi as ca
import numpy as np

import spacerobot as sr
from spacerobot.elements import Reference, SectionContext, TimeProfile, cubic_blend, quantity


@sr.register
class Lemniscate(Reference):
    """A lemniscate of Gerono in the x-y plane, from its crossing back to its crossing."""

    kind: Literal["lemniscate"] = "lemniscate"
    size: float = quantity("m", "from the crossing to the farthest point", default=0.1, gt=0)
    duration: float = quantity("s", "time for the whole figure", default=10.0, gt=0)

    def moved(self, context: SectionContext) -> TimeProfile:
        """Displacement and its derivatives, by CasADi's own derivative along the blend."""
        size, blend = context.number("size"), cubic_blend(context)
        angle = ca.SX.sym("angle")
        curve = ca.vertcat(ca.sin(angle), ca.sin(angle) * ca.cos(angle), 0)
        slope = ca.jacobian(curve, angle)
        shape = ca.Function("lemniscate", [angle], [curve, slope, ca.jacobian(slope, angle)])
        turn = 2 * np.pi
        value, first, second = shape(turn * blend.value)
        rate, acceleration = turn * blend.rate, turn * blend.acceleration
        return TimeProfile(
            size * value, size * first * rate, size * (second * rate**2 + first * acceleration)
        )

    def jumps(self) -> tuple[float, ...]:
        """Its end."""
        return (self.duration,)
