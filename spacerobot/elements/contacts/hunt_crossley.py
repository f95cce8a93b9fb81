r"""Normal force by Hunt and Crossley, Coulomb friction.

For the indentation $d$ and the sliding velocity $v_t$,

$$ N = \max\bigl( k\,d^n (1 + a \dot d),\ 0 \bigr), \qquad
   F_t = -\frac{\mu N\,v_t}{\sqrt{|v_t|^2 + v_s^2}} $$

with the stiffness $k$, the exponent $n$, the dissipation $a$, the coefficient of friction $\mu$ and the slip
velocity $v_s$ that regularises it.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import casadi as ca
from pydantic import model_validator

from spacerobot.common.section import quantity
from spacerobot.elements.contacts.contact import Contact, ContactForce, booked, touches, watch
from spacerobot.elements.core.context import ContactContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register

_SHALLOWEST = 1e-30
"""Indentations [m] below this count as zero, so that powers of them have finite derivatives."""
_ITERATIONS = 6


@register
class HuntCrossley(Contact):
    """Normal force k d^n (1 + a d') of the indentation d, never pulling, with Coulomb friction."""

    kind: Literal["hunt_crossley"] = "hunt_crossley"
    stiffness: float = quantity("N/m^exponent", "k, force at an indentation of 1 m", gt=0)
    exponent: float = quantity("1", "n; 1 for a spring, 1.5 for a sphere by Hertz", default=1.5, ge=1, le=10)
    dissipation: float | None = quantity(
        "s/m",
        "a, force per speed of indentation relative to the spring's; 0 if not given",
        default=None,
        ge=0,
    )
    restitution: float | None = quantity(
        "1",
        "in place of the dissipation: speed of parting over speed of approach of two free bodies that meet "
        "head-on at `restitution_speed`; nearer to 1 when slower",
        default=None,
        ge=0.01,
        lt=1,
    )
    restitution_speed: float | None = quantity(
        "m/s", "speed of approach at which `restitution` holds", default=None, gt=0
    )
    friction: float = quantity("1", "coefficient of friction mu", default=0.0, ge=0)
    slip_velocity: float = quantity(
        "m/s",
        "sliding speed at which friction has reached 1/sqrt(2) of mu times the normal force",
        default=1e-3,
        gt=0,
    )

    @model_validator(mode="after")
    def _check(self) -> HuntCrossley:
        if self.dissipation is not None and self.restitution is not None:
            raise ValueError("give either `dissipation` or `restitution`, not both")
        if (self.restitution is None) != (self.restitution_speed is None):
            raise ValueError("`restitution` and `restitution_speed` belong together: give both or neither")
        return self

    def build(self, contact: ContactContext) -> Contribution:
        """Forces of every pair of shapes, with their stored energy and dissipated power."""
        context, touching = contact.context, touches(contact)
        stiffness, exponent = context.number("stiffness"), context.number("exponent")
        # the coefficient a (1x1) [s/m]
        if self.restitution is None:
            dissipation = context.number("dissipation") if self.dissipation is not None else ca.SX(1, 1)
        else:
            number, path = context.parameters, context.path
            relative = speed_ratio(number(f"{path}.restitution"))
            dissipation = context.once("dissipation", relative / number(f"{path}.restitution_speed"))
        energy, presses = ca.SX(1, 1), []
        for touch in touching:
            # d' = -opening. The force stores the rate spring d' in the spring, exerts the power
            # N opening + F_t . v_t on the bodies, and so dissipates (spring - N) opening - F_t . v_t.
            depth = ca.fmax(-touch.gap, _SHALLOWEST)
            spring = ca.if_else(touch.gap < 0, stiffness * depth**exponent, 0)
            normal = ca.fmax(spring * (1 - dissipation * touch.opening), 0)
            # force on the second across the normal (3x1): mu N against sliding, linear near none
            path = f"{context.path}.friction"
            coefficient = context.once("friction", context.parameters.sparse(path))
            if not coefficient.nnz():
                friction = ca.SX(3, 1)
            else:
                sliding, slip = touch.sliding, context.number("slip_velocity")
                friction = -coefficient * normal * sliding / ca.sqrt(ca.dot(sliding, sliding) + slip**2)
            dissipated = (spring - normal) * touch.opening - ca.dot(friction, touch.velocity)
            presses.append(ContactForce(normal * touch.normal + friction, normal, dissipated))
            energy += spring * depth / (exponent + 1)
        pull = [dissipation * touch.opening - 1 for touch in touching] if dissipation.nnz() else []
        marks = watch(contact, touching, self, pull, rough=not self.exponent.is_integer())
        contribution = booked(contact, touching, presses)
        return dataclasses.replace(contribution, energy=energy, events=marks.events, fine=marks.fine)

    def assumptions(self) -> list[str]:
        """Contact force and outputs."""
        sentences = ["one pair of opposite forces for each pair of shapes, at one point"]
        if self.friction:
            sentences.append(
                f"friction is regularised: what sticks creeps, at {self.slip_velocity:g} m/s under "
                f"{0.5**0.5:.2g} of the greatest friction, and slower under less"
            )
        return sentences

    def words(self) -> str:
        """Stiffness and dissipation."""
        if self.restitution is not None:
            loss = f"restitution {self.restitution:g} at {self.restitution_speed:g} m/s"
        else:
            loss = f"dissipation {self.dissipation or 0:g} s/m"
        return f"{self.stiffness:g} N/m^{self.exponent:g}, {loss}, friction {self.friction:g}"


def speed_ratio(restitution: ca.SX) -> ca.SX:
    """Product x = a v of dissipation and approach speed for a coefficient of restitution e (1x1 each).

    Two bodies of the reduced mass m meet with the speed v: m d'' = -k d^n (1 + a d'). With u = d' and
    u du = d'' dd the variables separate,

        u du / (1 + a u) = -(k / m) d^n dd,

    and the left side has the integral (a u - ln(1 + a u)) / a^2. Compression leads from u = v to 0, expansion
    from 0 to -e v, over the same indentations, so that the right sides have equal magnitudes:

        x - ln(1 + x) = -e x - ln(1 - e x)

    for any k, n and m. Newton's method solves it for w = -ln(1 - e x), from an approximation within 2 % of
    the root for every e between 0.01 and 1.
    """
    e, lost_share = restitution, 1 - restitution
    near = lost_share * (1.5 - 0.5 * lost_share**2.75) / e
    w = (1 + e) * near - ca.log1p(near)
    for _ in range(_ITERATIONS):
        x = -ca.expm1(-w) / e
        slope = 1 + (1 / (1 + x) - 1 - e) * ca.exp(-w) / e
        w = w - (ca.log1p(x) + w - (1 + e) * x) / slope
    return -ca.expm1(-w) / e
