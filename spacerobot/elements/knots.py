"""Motions through knots, cheap for many joints: what depends on time alone is computed once.

Time is cut into intervals by knots; in each lie s points in the same way, the first and the last on its ends.
A position is the polynomial of degree 2 s - 1 that has the values and rates given at the points (the cubic
for s = 2), a force that of degree s - 1 (linear for s = 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements.motion import Profile
from spacerobot.elements.numbers import Context

Polynomial = np.polynomial.Polynomial
ROUNDING = 1e-12
"""Of a time."""


@dataclass(frozen=True)
class Knots:
    """Where an instant lies among n intervals; behind the last one everything rests.

    Attributes
    ----------
    inside
        Which interval it lies in: 1 for that, 0 for the others (n x 1); none behind the last one.
    after
        Whether it lies behind the last one (1x1).
    u
        Part of the interval that lies behind it (1x1).
    width
        Of the interval (1x1) [s].
    pace
        One over that, zero behind the last one (1x1) [1/s].
    nodes
        Parts of an interval at which its points lie (s,).
    """

    inside: ca.SX
    after: ca.SX
    u: ca.SX
    width: ca.SX
    pace: ca.SX
    nodes: Array

    @classmethod
    def at(cls, context: Context, times: Array, points: int, time: ca.SX | None = None) -> Knots:
        """The law's time, or another one (1x1) [s], among the times of all points, rising from 0.

        Steps end on the knots where the law counts its time from the start, and where no time is given.
        """
        stepped = time is None and context.since is None
        now = context.time if time is None else time
        ends = times[:: points - 1]
        behind = [ca.SX(1)]
        for i, knot in enumerate(ends[1:], start=1):
            behind.append(now >= (context.jump(f"knots.{i}", float(knot)) if stepped else float(knot)))
        if not stepped:  # where a phase ends with the plan, its last step still belongs to it
            behind[-1] = now > float(ends[-1]) * (1 + ROUNDING)
        widths = ca.DM(np.diff(ends))
        inside = ca.vertcat(*behind[:-1]) - ca.vertcat(*behind[1:])
        pace = ca.dot(inside, 1 / widths)
        u = now * pace - ca.dot(inside, ca.DM(ends[:-1]) / widths)
        return cls(inside, behind[-1], u, ca.dot(inside, widths), pace, nodes_of(times, points))

    def here(self, values: ca.SX) -> ca.SX:
        """What belongs to the interval (m x 1), of what belongs to each (n x m); zero behind the last one."""
        return ca.mtimes(values.T, self.inside)

    def points(self, values: ca.SX) -> list[ca.SX]:
        """What stands at the points of the interval (s of m x 1), of what stands at all points (rows)."""
        step, last = len(self.nodes) - 1, values.size1() - 1
        return [self.here(values[j : last - step + j + 1 : step, :]) for j in range(step + 1)]

    def force(self, values: ca.SX) -> ca.SX:
        """Force (m x 1) through what stands at the points; none behind the last interval."""
        return self._sum(lagrange(self.nodes), self.points(values))

    def motion(self, values: ca.SX, rates: ca.SX) -> Profile:
        """Position (m x 1) through what stands at the points."""
        found = self.between(self.points(values), self.points(rates))
        return Profile(found.value + values[-1, :].T * self.after, found.rate, found.acceleration)

    def between(self, values: list[ca.SX], rates: list[ca.SX]) -> Profile:
        """The same for what stands at the points of the interval (s of m x 1 each)."""
        by_value, by_rate = hermite(self.nodes)
        found = []
        for order in range(3):
            first, second = ([p.deriv(order) for p in each] for each in (by_value, by_rate))
            scale = self.pace**order
            found.append(scale * (self._sum(first, values) + self.width * self._sum(second, rates)))
        return Profile(*found)

    def _sum(self, weights: list[Polynomial], values: list[ca.SX]) -> ca.SX:
        """Values (s of m x 1), weighted by polynomials of the part of the interval."""
        terms = []
        for weight, value in zip(weights, values, strict=True):
            power = ca.SX(0)
            for coefficient in reversed(weight.coef):
                power = power * self.u + float(coefficient)
            terms.append(power * value)
        return sum(terms[1:], terms[0])


def nodes_of(times: Array, points: int) -> Array:
    """Parts of each interval at which its points lie (s,), the same in all.

    Raises
    ------
    ValueError
        If they are not, or the last interval has too few.
    """
    count, rest = divmod(len(times) - 1, points - 1)
    if rest:
        raise ValueError(f"times: found {len(times)}, which intervals of {points} points do not make")
    rows = np.array([times[i * (points - 1) : (i + 1) * (points - 1) + 1] for i in range(count)])
    parts = (rows - rows[:, :1]) / (rows[:, -1:] - rows[:, :1])
    if np.abs(parts - parts[0]).max() > 1e-6:
        raise ValueError("times: points lie at other parts of one interval than of another")
    found: Array = parts[0]
    return found


def lagrange(nodes: Array) -> list[Polynomial]:
    """Polynomials (s) that are 1 at one node each and 0 at the others."""
    matrix = np.linalg.inv(np.vander(nodes, increasing=True))
    return [Polynomial(column) for column in matrix.T]


def hermite(nodes: Array) -> tuple[list[Polynomial], list[Polynomial]]:
    """Polynomials (s each) of which one has the value, another the rate 1 at one node; else both are 0."""
    size = 2 * len(nodes)
    powers = np.vander(nodes, size, increasing=True)
    slopes = np.hstack([np.zeros((len(nodes), 1)), powers[:, :-1] * np.arange(1, size)])
    columns = np.linalg.inv(np.vstack([powers, slopes])).T
    found = [Polynomial(column) for column in columns]
    return found[: len(nodes)], found[len(nodes) :]
