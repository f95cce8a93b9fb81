"""The planned motion of a tip, by closed forms of the rotation between two knots."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import pinocchio as pin
from scipy.interpolate import KroghInterpolator

from spacerobot.common.arrays import Array
from spacerobot.elements.references.knot_motion import ends_of, slices_of
from spacerobot.elements.references.plan import PlanReference
from spacerobot.elements.references.plan_following import PhasedPlan, TipMotion
from tests.oracles.engine.kinematics import Kinematics, cross
from tests.oracles.engine.references import Begins, Leads, Motion, leading
from tests.oracles.engine.robot_law import Asking

Piece = TypeVar("Piece")
SMALL = 1e-3
"""Angle [rad] below which closed forms are replaced by their series."""


class Pieces(Generic[Piece]):
    """What is made of the points of each interval, when first asked for."""

    def __init__(self, times: Sequence[float], points: int, make: Callable[[slice], Piece]) -> None:
        self._slices, self._make = slices_of(times, points), make
        self._begins = np.array([times[own.start] for own in self._slices])
        self._made: dict[int, Piece] = {}

    def at(self, within: float) -> Piece:
        """That of the interval that a time before the last one lies in."""
        k = int(np.searchsorted(self._begins, within, side="right")) - 1
        if k not in self._made:
            self._made[k] = self._make(self._slices[k])
        return self._made[k]


def window_ends(plan: PhasedPlan, phases: bool) -> tuple[float, ...]:
    """Times since a phase began of a plan's knots behind the first one, of each of its phases."""
    knots = [plan.times[k] for k in ends_of(plan.times, plan.points)]
    windows = [*plan.phases.values()] if phases else []
    windows = windows or [(0.0, plan.times[-1])]
    return tuple(t - begin for begin, end in windows for t in knots if begin < t <= end)


def plan_time(plan: PhasedPlan, now: Asking) -> tuple[float, float]:
    """Time in the plan, and one that tells which piece is meant [s]."""
    if not (now.phase and plan.phases):
        return now.t, now.within
    begin, last = plan.phases.get(now.phase, (plan.times[-1],) * 2)
    return min(begin + now.t, last), min(begin + now.within, last)


def hermite(times: Array, values: Array, rates: Array) -> KroghInterpolator:
    """Polynomial with these values and rates (s, m) at times (s,)."""
    both = np.stack([values, rates], axis=1).reshape(-1, values.shape[1])
    return KroghInterpolator(np.repeat(times, 2), both)


@dataclass(frozen=True)
class PlannedTip:
    """Leads a tip along a plan."""

    planned: TipMotion
    ends: tuple[float, ...] = ()

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""
        del kinematics
        plan = self.planned
        if within >= plan.times[-1]:
            none, rotation = np.zeros(3), pin.exp3(np.array(plan.rotation[-1]))
            return Motion(np.array(plan.position[-1]), none, none, rotation, none, none)
        way, turning, first = self._pieces.at(within)
        position, velocity, bend = way.derivatives(t, 3)
        vector, rate, acceleration = turning.derivatives(t, 3)
        spin, gain = _spin(vector, rate, acceleration)
        return Motion(position, velocity, bend, pin.exp3(vector) @ first, spin, gain)

    @functools.cached_property
    def _pieces(self) -> Pieces[tuple[KroghInterpolator, KroghInterpolator, Array]]:
        return Pieces(self.planned.times, self.planned.points, self._piece)

    def _piece(self, piece: slice) -> tuple[KroghInterpolator, KroghInterpolator, Array]:
        """Position, rotation vector since the knot behind, and rotation there (3, 3)."""
        plan, times = self.planned, np.array(self.planned.times[piece])
        way = hermite(times, np.array(plan.position[piece]), np.array(plan.velocity[piece]))
        first, *others = (pin.exp3(np.array(vector)) for vector in plan.rotation[piece])
        turns = np.array([np.zeros(3), *(pin.log3(other @ first.T) for other in others)])
        # the left Jacobian is the transposed right one
        rates = [np.linalg.solve(pin.Jexp3(r).T, w) for r, w in zip(turns, plan.spin[piece], strict=True)]
        return way, hermite(times, turns, np.array(rates)), first


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
def _(reference: PlanReference, begins: Begins) -> Leads:
    del begins
    return PlannedTip(reference.planned)
