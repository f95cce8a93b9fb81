"""Braking of a tip or held object to rest."""

from __future__ import annotations

from typing import Literal

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.core.context import ReferenceContext
from spacerobot.elements.core.desired_motion import DesiredMotion, InitialMotion, TimeProfile
from spacerobot.elements.core.registry import register
from spacerobot.elements.references.reference import DEGREE, Reference, carried

_LONGEST = 1.5
"""Maximum slope of u^2 (3 - 2 u)."""
_STILL = 1e-12
"""Number [m/s, rad/s] whose square is added to that of a speed, for a finite derivative at zero; also a
time [s]."""


@register
class Brake(Reference):
    """Deceleration to rest from the initial velocity and spin, as fast as two deceleration limits allow."""

    kind: Literal["brake"] = "brake"
    deceleration: float = quantity("m/s^2", "maximum deceleration", default=0.01, gt=0)
    spin_deceleration_deg: float = quantity("deg/s^2", "maximum angular deceleration", default=1.0, gt=0)

    def motion(
        self, context: ReferenceContext, start: InitialMotion, pivot: ca.SX | None = None
    ) -> DesiredMotion:
        """Velocity and spin decrease together, each along its own direction; attached bodies move rigidly."""
        spin, linear = start.angular_velocity, start.velocity
        if pivot is not None:
            linear = linear + cross(spin, pivot - start.origin)
        limits = context.number("deceleration"), context.number("spin_deceleration_deg") * DEGREE
        speeds = (ca.sqrt(ca.dot(v, v) + _STILL**2) for v in (linear, spin))
        times = [speed / limit for speed, limit in zip(speeds, limits, strict=True)]
        full = _LONGEST * ca.fmax(*times) + _STILL
        duration, ends = context.begun("duration", full), context.jump("end", full)
        u = ca.if_else(context.time < ends, context.time / duration, 1)
        way = duration * u * (1 - u * u * (1 - u / 2))
        fall, slope = 1 - u * u * (3 - 2 * u), -6 * u * (1 - u) / duration

        def fading(name: str, vector: ca.SX) -> TimeProfile:
            first = context.begun(name, vector)
            return TimeProfile(first * way, first * fall, first * slope)

        return carried(context, start, pivot, (fading("velocity", linear), fading("spin", spin)))

    def way(self) -> tuple[Array, Array]:
        """Zero displacement and rotation: the path is not known in advance."""
        return np.zeros((1, 3)), np.zeros((1, 3))
