"""Amnesia controller (Eq. 37, 38)."""

from __future__ import annotations

import casadi as ca

from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import State
from spacerobot.elements.core.desired_motion import TimeProfile


def correct(tip: TipContext, key: str, error: ca.SX) -> tuple[State, TimeProfile]:
    """State X_ta, and the correction G_e X_ta of the reference velocity with its rate.

    X_ta' = -t_a X_ta + (X_ref - X_tip); ``key`` is the section's in the tip's.
    """
    section = tip.context.at(f"{tip.path}.{key}")
    ge, ta = section.number("ge"), section.number("ta")
    size = error.size1()
    further = f"{tip.key}." if tip.key.startswith("controllers.") else ""
    name = f"{tip.label}/{further}{key}"
    memory = ca.SX.sym(name, size)
    rate = error - ta * memory
    state = State(name, memory, ca.SX.zeros(size), rate)
    return state, TimeProfile(ge * memory, ge * rate, ca.SX(size, 1))
