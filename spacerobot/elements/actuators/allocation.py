r"""Thruster allocation with minimum propellant: an exact optimum, by a path of fixed length.

$$ \min_a \ \frac{|A a - w|^2}{2 \varepsilon} + \sum_i c_i \Bigl( a_i + \frac{d\,a_i^2}{2} \Bigr), \qquad
   0 \le a \le 1 $$

$\varepsilon$ is so small that the nearest wrench has priority over minimum propellant; $d$ distributes the
load evenly among equivalent thrusters. With $B_i = A_i / c_i$ the optimum is

$$ a_i = \min(\max(s_i, 0), 1), \qquad s_i = \frac{B_i \cdot y - 1}{d}, \qquad \varepsilon y = w - A a, $$

so $y$ is the price of the wrench in propellant: a thruster opens if the value of its wrench at this price
exceeds its propellant. The solution is piecewise linear in $w$. It is followed along a straight line that
ends at $w$, from a $y$ with a known wrench. At each kink one thruster changes between shut, throttled and
open, and between kinks

$$ s' = B^\top y' / d, \qquad \Bigl( \varepsilon I + \frac1d \sum_\text{throttled} A_i B_i^\top \Bigr) y'
   = w', $$

where a prime is the derivative along the path. The path only determines the sets of throttled and open
thrusters; their throttles then solve one linear system. Derivatives therefore go through that system alone,
and are exact where no thruster is at a kink.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array

NEAREST = 1e-8
"""e: relative error of the wrench that is accepted to save propellant."""
EVEN = 1e-2
"""d: the propellant is at most 1 + d/2 times the minimum."""
FAR = 100.0
"""Norm of y at the start of a path that begins with open thrusters."""
SLACK = 1e-8
"""Margin by which s of a throttled thruster passes 0 or 1 before its set changes, against rounding."""
NOT_DRIVEN = 1e-6
"""Fraction of the largest side of a wrench box below which an axis counts as not actuated."""
SHUT, THROTTLED, OPEN = 0, 1, 2
_GRID = 2.0**20
_NO_ZERO = 1e-300


@dataclass(frozen=True)
class ThrusterLayout:
    """Wrenches and propellant consumption of thrusters at full thrust.

    Attributes:
        matrix: A (m x n): wrench of each thruster, with rows scaled to similar magnitude.
        gains: B (m x n): A_i / c_i, with the propellant consumption c scaled to a mean of 1.
        squares: ``A_i B_i^T / d`` of each thruster (m x m).
    """

    matrix: ca.SX
    gains: ca.SX
    squares: tuple[ca.SX, ...]

    @classmethod
    def of(cls, matrix: ca.SX, propellant: ca.SX) -> ThrusterLayout:
        """Build the layout from wrenches (m x n) and flows of propellant (n x 1), in any unit."""
        gains = ca.sparsify(
            ca.mtimes(matrix, ca.diag(ca.sum1(propellant) / (propellant.numel() * propellant)))
        )
        pairs = zip(ca.horzsplit(matrix), ca.horzsplit(gains), strict=True)
        return cls(matrix, gains, tuple(ca.mtimes(a, b.T) / EVEN for a, b in pairs))


@dataclass(frozen=True)
class _Path:
    """A place on the way.

    Attributes:
        levels: State of each thruster (n x 1): `SHUT`, `THROTTLED` or `OPEN`.
        values: s (n x 1).
        wrench: Vector from the wrench at the beginning to the required one (m x 1).
        part: Share of the path covered, 0 to 1 (1x1).
        ended: Whether it is all of it (1x1).
    """

    levels: ca.SX
    values: ca.SX
    wrench: ca.SX
    part: ca.SX
    ended: ca.SX


def allocate(layout: ThrusterLayout, wrench: ca.SX, steps: int) -> ca.SX:
    """Throttles a (n x 1) of the thrusters, fractions of full thrust.

    If the steps do not suffice, the throttles are those of the last kink, close to the optimum of a smaller
    or larger wrench, with zero derivatives.

    Args:
        layout: Layout of the thrusters.
        wrench: w (m x 1), its rows scaled like those of A.
        steps: Maximum number of kinks.
    """
    path = _begin(layout, wrench)
    for _ in range(steps):
        path = _step(layout, path)
    rough = ca.floor(_cut(path.values) * _GRID) / _GRID
    # Parts (n x 1) that are optimal if no level changes. The second round takes away what rounding leaves
    # of a system that is singular but for e.
    throttled, parts, price = path.levels == THROTTLED, path.levels == OPEN, ca.SX.zeros(wrench.numel())
    system = _system(layout, path.levels)
    for _ in range(2):
        lacking = throttled * (1 + EVEN * parts - ca.mtimes(layout.gains.T, price))
        residual = wrench - ca.mtimes(layout.matrix, parts) - NEAREST * price
        change = ca.ldl_solve(residual + ca.mtimes(layout.matrix, lacking) / EVEN, *system)
        parts = parts + (throttled * ca.mtimes(layout.gains.T, change) - lacking) / EVEN
        price = price + change
    return ca.if_else(path.ended, _cut(parts), rough)


def steps_needed(matrix: Array, propellant: Array) -> int:
    """Maximum number of kinks for :func:`allocate`: 1.25 times that of paths to random wrenches.

    The wrenches lie inside and outside the attainable set. The result is rounded up to a multiple of m + n,
    and at most 3 (m + n).

    Args:
        matrix, propellant: Numbers for :meth:`ThrusterLayout.of`.
    """
    size, max_multiple = sum(matrix.shape), 3
    layout = ThrusterLayout.of(ca.sparsify(ca.SX(matrix)), ca.SX(propellant))
    wrenches = np.random.default_rng(0).normal(size=(len(matrix), 100))
    reach = np.maximum(matrix.T @ wrenches, 0).sum(0) / (wrenches**2).sum(0)
    wrenches = np.hstack([wrenches * reach * part for part in (0.1, 0.4, 0.6, 1.0, 2.0)])
    w = ca.SX.sym("w", len(matrix))
    path = _begin(layout, w)
    names = ("levels", "values", "wrench", "part", "ended")
    place = _Path(*(ca.SX.sym(name, *getattr(path, name).shape) for name in names))
    begin = ca.Function("begin", [w], [getattr(path, name) for name in names])
    after = _step(layout, place)
    step = ca.Function("step", [getattr(place, n) for n in names], [getattr(after, n) for n in names])
    paths = begin.map(wrenches.shape[1])(wrenches)
    for count in range(max_multiple * size):
        if bool(ca.mmin(paths[-1])):
            return size * int(np.ceil((1.25 * count + 1) / size))
        paths = step.map(wrenches.shape[1])(*paths)
    return max_multiple * size


def _begin(layout: ThrusterLayout, command: ca.SX) -> _Path:
    """Path at zero wrench.

    For a wrench beyond half of what all helpful thrusters give along it, path with these open.
    """
    square = ca.dot(command, command)
    reached = ca.sum1(ca.fmax(ca.densify(ca.mtimes(layout.matrix.T, command)), 0))
    size = ca.if_else(square > reached / 2, FAR / ca.sqrt(square + _NO_ZERO), 0)
    values = (ca.densify(ca.mtimes(layout.gains.T, size * command)) - 1) / EVEN
    wrench = command - ca.mtimes(layout.matrix, _cut(values)) - NEAREST * size * command
    return _Path((values > 0) + (values >= 1), values, wrench, ca.SX(0), ca.SX(0))


def _step(layout: ThrusterLayout, path: _Path) -> _Path:
    """Path at its next kink, or at its end."""
    solved = ca.ldl_solve(path.wrench, *_system(layout, path.levels))
    moves = ca.densify(ca.mtimes(layout.gains.T, solved)) / EVEN  # B^T y (n x 1)
    levels, values, remaining_part = [], [], 1 - path.part
    kinks, directions = [], []
    for i, level in enumerate(ca.vertsplit(path.levels)):
        move = moves[i] + _NO_ZERO
        up = move > 0
        border = level + up - 1  # of s: 0 or 1, else there is none on that side
        none = border * border != border
        directions.append(2 * up - 1)
        threshold = border + SLACK * (level == THROTTLED) * directions[i]
        kinks.append(ca.fmax((threshold - path.values[i]) / move, 0) + 2 * none)
    step_part = remaining_part
    for kink in kinks:
        step_part = ca.fmin(step_part, kink)
    free = ca.SX(1)  # until one is found: of several at the same kink the first
    for i, (kink, up) in enumerate(zip(kinks, directions, strict=True)):
        hit = free * (kink == step_part)
        free = free - hit
        levels.append(path.levels[i] + hit * up)
        values.append(path.values[i] + step_part * moves[i])
    return replace(
        path, levels=ca.vertcat(*levels), values=ca.vertcat(*values), part=path.part + step_part, ended=free
    )


def _system(layout: ThrusterLayout, levels: ca.SX) -> tuple[ca.SX, ca.SX, list[int]]:
    """LDL' factors of the system matrix (m x m) of the throttled thrusters."""
    system = NEAREST * ca.SX.eye(layout.matrix.size1())
    for level, square in zip(ca.vertsplit(levels), layout.squares, strict=True):
        system += (level == THROTTLED) * square
    diagonal, factor, order = ca.ldl(system)
    return diagonal, factor, order


def _cut(values: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(values, 0), 1)


def largest_box(full: Array, rows: Sequence[int]) -> Array:
    """Half side lengths of the box of wrenches that is inscribed in those which thrusters can deliver.

    Args:
        full: Wrench of each thruster at full thrust (6, n) [N, N m].
        rows: Entries of a wrench that move the base.

    Returns:
        Array: Maximum force along [N] and torque about [N m] each axis (6,); the sides are in the ratio of
            the maximum on each axis alone.
    """
    wrench_rows = full[rows]
    single_axis = np.array(
        [min(_reach(wrench_rows, sign * side) for sign in (1, -1)) for side in np.eye(len(rows))]
    )
    single_axis[single_axis < NOT_DRIVEN * single_axis.max(initial=0.0)] = 0.0
    half_sides, sides = np.zeros(6), np.flatnonzero(single_axis)
    if sides.size:
        corners = (np.array(signs) for signs in itertools.product((1, -1), repeat=sides.size))
        onto = np.eye(len(rows))[:, sides] * single_axis[sides]
        half_sides[rows] = min(_reach(wrench_rows, onto @ signs) for signs in corners) * single_axis
    return half_sides


def _reach(full: Array, wrench: Array) -> float:
    """Largest share of a wrench that throttled nozzles give without any other component."""
    from scipy.optimize import linprog  # takes time to load, and a run needs none of it

    count = full.shape[1]
    size = np.abs(full).max(axis=1, keepdims=True) + (np.abs(full).max(axis=1, keepdims=True) == 0)
    equal = np.hstack([full, -wrench[:, None]]) / size
    cost = np.append(np.zeros(count), -1.0)
    bounds = [(0, 1)] * count + [(0, None)]
    solution = linprog(cost, A_eq=equal, b_eq=np.zeros(len(wrench)), bounds=bounds)
    return float(solution.x[-1]) if solution.status == 0 else 0.0
