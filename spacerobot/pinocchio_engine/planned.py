"""The planned motion of a tip, by closed forms of the rotation between two knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.interpolate import KroghInterpolator

from spacerobot.arrays import Array
from spacerobot.elements.planned import TipMotion
from spacerobot.elements.references.plan import Plan
from spacerobot.pinocchio_engine.kinematics import Kinematics, cross
from spacerobot.pinocchio_engine.references import Begins, Leads, Motion, leading

SMALL = 1e-3
"""Angle [rad] below which closed forms are replaced by their series."""


@dataclass(frozen=True)
class PlannedTip:
    """Leads a tip along a plan."""

    planned: TipMotion
    ends: tuple[float, ...] = ()

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""
        del kinematics
        plan = self.planned
        times = np.array(plan.times)
        if within >= times[-1]:
            none, rotation = np.zeros(3), pin.exp3(np.array(plan.rotation[-1]))
            return Motion(np.array(plan.position[-1]), none, none, rotation, none, none)
        piece = interval(times, plan.points, within)
        way = hermite(times[piece], np.array(plan.position[piece]), np.array(plan.velocity[piece]))
        first, *others = (pin.exp3(np.array(vector)) for vector in plan.rotation[piece])
        turns = np.array([np.zeros(3), *(pin.log3(other @ first.T) for other in others)])
        # the left Jacobian is the transposed right one
        rates = [np.linalg.solve(pin.Jexp3(r).T, w) for r, w in zip(turns, plan.spin[piece], strict=True)]
        vector, rate, acceleration = hermite(times[piece], turns, np.array(rates)).derivatives(t, 3)
        spin, gain = _spin(vector, rate, acceleration)
        position, velocity, bend = way.derivatives(t, 3)
        return Motion(position, velocity, bend, pin.exp3(vector) @ first, spin, gain)


def interval(times: Array, points: int, within: float) -> slice:
    """Points of the interval that a time before the last one lies in."""
    k = int(np.searchsorted(times[:: points - 1], within, side="right")) - 1
    return slice(k * (points - 1), (k + 1) * (points - 1) + 1)


def hermite(times: Array, values: Array, rates: Array) -> KroghInterpolator:
    """Polynomial with these values and rates (s, m) at times (s,)."""
    both = np.stack([values, rates], axis=1).reshape(-1, values.shape[1])
    return KroghInterpolator(np.repeat(times, 2), both)


def _spin(vector: Array, rate: Array, acceleration: Array) -> tuple[Array, Array]:
    """Spin (3,) and its rate of a rotation whose vector changes.

    w = r' + a r x r' + b r x (r x r'),  a = (1 - cos |r|) / |r|^2,  b = (|r| - sin |r|) / |r|^3.
    """
    angle, along = float(np.linalg.norm(vector)), float(vector @ rate)
    if angle < SMALL:
        a, b = 1 / 2 - angle**2 / 24, 1 / 6 - angle**2 / 120
        a_rate, b_rate = -along / 12, -along / 60
    else:
        sin, cos = np.sin(angle), np.cos(angle)
        a, b = (1 - cos) / angle**2, (angle - sin) / angle**3
        a_rate = (angle * sin - 2 * (1 - cos)) / angle**4 * along
        b_rate = (3 * sin - 2 * angle - angle * cos) / angle**5 * along
    swing, swing_rate = cross(vector, rate), cross(vector, acceleration)
    spin = rate + a * swing + b * cross(vector, swing)
    gain = acceleration + a * swing_rate + b * (cross(vector, swing_rate) + cross(rate, swing))
    return spin, gain + a_rate * swing + b_rate * cross(vector, swing)


@leading.register
def _(reference: Plan, begins: Begins) -> Leads:
    del begins
    return PlannedTip(reference.planned)
