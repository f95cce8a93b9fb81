"""Motions through knots.

A rollout passes only the numbers of the present interval, so many cost no more than few.

Knots divide time into intervals. Each interval has s points at the same relative positions, the first and
last at its ends. A position is the polynomial of degree 2 s - 1 with given values and rates at the points
(the cubic for s = 2), a force the polynomial of degree s - 1 (linear for s = 2). After the last knot
everything is at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.core.desired_motion import TimeProfile
from spacerobot.elements.core.event import Event
from spacerobot.elements.core.section_context import SectionContext

ROUNDING = 1e-12
"""Relative tolerance of a time."""


@dataclass(frozen=True)
class Knots:
    """Position of an instant among n intervals, and tables of the intervals' values and the final ones.

    Attributes:
        context: Context of the law.
        cursor: Number of the cursor whose row is the index of the interval, n after the last one.
        u: Elapsed fraction of the interval (1x1).
        width: Width of the interval (1x1) [s].
        pace: Reciprocal of the width, zero after the last interval (1x1) [1/s].
        nodes: Relative positions of an interval's points, 0 to 1 (s,).
        event: Event at the end of an interval; None if the end times are known in advance.
        parted: Whether each interval has rows of its own at both ends, so that forces may jump at knots.
    """

    context: SectionContext
    cursor: int
    u: ca.SX
    width: ca.SX
    pace: ca.SX
    nodes: Array
    event: Event | None
    parted: bool = False

    @classmethod
    def at(
        cls,
        context: SectionContext,
        times: Array,
        points: int,
        time: ca.SX | None = None,
        begin: ca.SX | None = None,
    ) -> Knots:
        """Position of an instant among the times of all points, which rise from 0.

        Args:
            context, times, points: Context of the law; times of its points (n,) [s]; number of points per
                interval.
            time: Time (1x1) [s] since an event; the law's own time if None.
            begin: Simulation time of the first point (1x1) [s]; the start if None.
        """
        constants, ends = context.constants, times[ends_of(times, points)]
        elapsed, limits = context.time if time is None else time, ends[1:].copy()
        is_clock = time is None and context.since is None
        if not is_clock or begin is not None:  # what ends with the plan still belongs to its last interval
            limits[-1] *= 1 + ROUNDING
        is_global = is_clock and begin is None
        name = f"knots {limits.tolist()}" if is_global else f"{context.path}.knots"
        if is_global:
            has_passed = [elapsed >= constants.jump(f"knot {end!r}", ca.SX(end)) for end in limits.tolist()]
        elif begin is not None:
            has_passed = [
                elapsed >= context.jump(f"knots.{i}", begin + end) for i, end in enumerate(limits, start=1)
            ]
            elapsed = elapsed - begin
        else:
            has_passed = [elapsed >= end for end in limits.tolist()]
        cursor = constants.cursor(name, sum(has_passed, ca.SX(0)))
        widths = np.append(np.diff(ends), 1.0)
        rows = [ends, np.append(limits, np.inf), widths, np.append(1 / widths[:-1], 0.0)]
        first, last, width, pace = ca.vertsplit(
            constants.window(name, ca.SX(ca.DM(np.column_stack(rows))), cursor)
        )
        event = None
        if not is_clock:
            owner = context.path if context.since is None else context.since.owner
            event = Event(f"{context.path}.knot", "reference", owner, elapsed - last, ca.SX(1), kink=True)
        nodes, parted = nodes_of(times, points), is_parted(times, points)
        return cls(context, cursor, (elapsed - first) * pace, width, pace, nodes, event, parted)

    def here(self, name: str, values: ca.SX) -> ca.SX:
        """Row of the present interval (m x 1), from the rows of all intervals and the final one."""
        # columns whose entries are not all equal
        changing = [
            j
            for j, column in enumerate(ca.horzsplit(values))
            if not (column.is_constant() and len(np.unique(ca.DM(column).full())) == 1)
        ]
        row = values[0, :].T
        if changing:
            constants, path = self.context.constants, f"{self.context.path}.{name}"
            row[changing] = constants.window(path, values[:, changing], self.cursor)
        return row

    def points(self, name: str, values: ca.SX, last: ca.SX) -> list[ca.SX]:
        """Values at the points of the present interval (s of m x 1), from those at all points (rows).

        After the last interval all of them are ``last`` (1 x m).
        """
        points = len(self.nodes)
        step = points if self.parted else points - 1
        count = (values.size1() - points) // step + 1
        blocks = [ca.vertcat(values[j : (count - 1) * step + j + 1 : step, :], last) for j in range(points)]
        row = self.here(name, ca.horzcat(*blocks))
        return ca.vertsplit(row, values.size2()) if values.size2() > 1 else ca.vertsplit(row)

    def force(self, name: str, values: ca.SX) -> ca.SX:
        """Force (m x 1) that interpolates the points; zero after the last interval."""
        points = self.points(name, values, ca.SX(1, values.size2()))
        return _summed([weight for weight, _, _ in lagrange(self.nodes, self.u)], points)

    def motion(self, name: str, values: ca.SX, rates: ca.SX) -> TimeProfile:
        """Position (m x 1) that interpolates the points; the last one after the last interval."""
        none = ca.SX(1, rates.size2())
        return self.between(
            self.points(name, values, values[-1, :]), self.points(f"{name} rate", rates, none)
        )

    def between(self, values: list[ca.SX], rates: list[ca.SX]) -> TimeProfile:
        """Interpolate values and rates at the points of the interval (s of m x 1 each)."""
        by_value, by_rate = hermite(self.nodes, self.u)
        return TimeProfile(
            *(
                self.pace**order * (_summed(first, values) + self.width * _summed(second, rates))
                for order, (first, second) in enumerate(zip(by_value, by_rate, strict=True))
            )
        )


def _summed(weights: Sequence[ca.SX], values: list[ca.SX]) -> ca.SX:
    """Values (s of m x 1), each times its weight."""
    terms = [weight * value for weight, value in zip(weights, values, strict=True)]
    return sum(terms[1:], terms[0])


def is_parted(times: Sequence[float] | Array, points: int) -> bool:
    """Whether each interval has rows of its own at both ends, so that times of knots occur twice."""
    count, remainder = divmod(len(times), points)
    return not remainder and count > 1 and times[points - 1] == times[points]


def slices_of(times: Sequence[float] | Array, points: int) -> list[slice]:
    """Rows of each interval."""
    step = points if is_parted(times, points) else points - 1
    return [slice(first, first + points) for first in range(0, len(times) - points + 1, step)]


def ends_of(times: Sequence[float] | Array, points: int) -> list[int]:
    """Row of each knot; the later one if a knot has two."""
    return [*(interval.start for interval in slices_of(times, points)), len(times) - 1]


def nodes_of(times: Array, points: int) -> Array:
    """Relative positions of the points of an interval (s,), 0 to 1, which all intervals share.

    Raises:
        ValueError: If the intervals differ in them, or the last interval has too few points.
    """
    if not is_parted(times, points) and (len(times) - 1) % (points - 1):
        raise ValueError(f"times: found {len(times)}, which intervals of {points} points do not make")
    rows = np.array([times[interval] for interval in slices_of(times, points)])
    parts = (rows - rows[:, :1]) / (rows[:, -1:] - rows[:, :1])
    if np.abs(parts - parts[0]).max() > 1e-6:
        raise ValueError("times: points lie at other parts of one interval than of another")
    nodes: Array = parts[0]
    return nodes


def lagrange(nodes: Array, u: ca.SX) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """Lagrange polynomials (s): 1 at one node each and 0 at the others, at u, with two derivatives."""
    polynomials = []
    for j, node in enumerate(nodes):
        other_nodes = np.delete(nodes, j)
        value, rate, bend = ca.SX(1), ca.SX(1, 1), ca.SX(1, 1)
        for other_node in other_nodes:
            value, rate, bend = (
                value * (u - other_node),
                rate * (u - other_node) + value,
                bend * (u - other_node) + 2 * rate,
            )
        scale = 1 / float(np.prod(node - other_nodes))
        polynomials.append((scale * value, scale * rate, scale * bend))
    return polynomials


def hermite(nodes: Array, u: ca.SX) -> tuple[list[tuple[ca.SX, ...]], list[tuple[ca.SX, ...]]]:
    """Hermite polynomials: value 1, or rate 1, at one node each.

    All other values and rates are zero. The polynomials (s) of each type at u come with their first and
    second derivatives.
    """
    by_value, by_rate = [], []
    for j, (lagrange_value, slope, bend) in enumerate(lagrange(nodes, u)):
        away, steep = u - nodes[j], 2 * float((1 / (nodes[j] - np.delete(nodes, j))).sum())
        value_factor, square, change = (
            1 - steep * away,
            lagrange_value * lagrange_value,
            2 * lagrange_value * slope,
        )
        turn = 2 * (slope * slope + lagrange_value * bend)
        by_value.append(
            (
                value_factor * square,
                value_factor * change - steep * square,
                value_factor * turn - 2 * steep * change,
            )
        )
        by_rate.append((away * square, square + away * change, 2 * change + away * turn))
    return list(zip(*by_value, strict=True)), list(zip(*by_rate, strict=True))
