"""Whether the order of what happens at one instant counts for a gradient.

Two events, or an event and a jump, whose times are the same may change places when parameters move them. A
cost has derivatives there only if both orders lead to the same: to the same state behind them, and, back from
its bar, to the same bars before them. All that this needs is known at the instant, so it costs little beside
a rollout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacerobot.numeric_function import NumericFunction
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import (
    COINCIDENT,
    FAINT,
    SAME,
    THINGS,
    RolloutArrays,
)
from spacerobot.rollout.tables import Integers, fill, gather

BETWEEN, BEHIND = 1, 2
"""Where a peak was met at an instant: between two things, or behind all."""

ROUNDING = 1e-9
"""Part of what was added up within which a sum is zero."""


@dataclass(frozen=True)
class _Step:
    """An event, or jump J as -1 - J; whether its time is its own; and what there was before.

    ``after`` are the constants behind it, with the rows of tables that were shown before it.
    """

    thing: int
    root: bool
    x: Array
    c: Array
    row: Integers
    rate: Array
    after: Array


@dataclass
class _Way:
    """Things in one order, what there is behind them, and which guards were above zero.

    ``seeds`` are those of peaks (n,) that are met before a step, by its number, or behind all.
    """

    x: Array
    c: Array
    row: Integers
    steps: list[_Step] = field(default_factory=list)
    above: set[int] = field(default_factory=set)
    seeds: dict[int, Array] = field(default_factory=dict)


@dataclass
class _Bars:
    """Bars of state, constants and time, and what rounding may make of each."""

    x: Array
    c: Array
    t: float
    noise_x: Array
    noise_c: Array
    noise_t: float


class CoincidentInstant:
    """Things at one instant of a rollout.

    Args:
        kernel, calls: With the reverse functions; the functions ready to be called.
        constants: Prepared constants of the rollout (nc,), and its random numbers (n,).
        record: The instant, of :class:`~spacerobot.rollout.rollout_arrays.CoincidentInstants`.
    """

    def __init__(
        self,
        kernel: Kernel,
        calls: Mapping[str, NumericFunction],
        constants: tuple[Array, Array],
        record: Any,
    ) -> None:
        (c, self._noise), self._kernel, self._f, self._record = constants, kernel, calls, record
        self._t, self._c = float(record["last"]), c.copy()
        self._c[[*kernel.switches, *kernel.jumps]] = record["mode"][:-1]
        number = min(int(record["number"]), THINGS)
        reversed_things = zip(record["thing"][:number][::-1], record["root"][:number][::-1], strict=True)
        self._things = [(int(thing), bool(root)) for thing, root in reversed_things]

    @property
    def event(self) -> int:
        """An event of it, -1 where there are jumps alone."""
        return max(thing for thing, _ in self._things)

    def order_counts(self, peaks: Array, seed: Array) -> bool:
        """Whether the order counts for a cost that depends on ``peaks`` (n,) by a ``seed`` (n,)."""
        kernel, record = self._kernel, self._record
        if record["missed"] or record["number"] > THINGS:
            return True
        ahead = self._guards(record["before"], self._c)
        at_roots = [
            thing for thing, root in self._things if root and (thing < 0 or np.isfinite(ahead[thing]))
        ]
        if len(at_roots) < 2:
            return False
        way = self._begin()
        for thing, root in self._things:
            self._go(way, thing, root)
        if not any(self._moves(step) for step in way.steps if step.thing in at_roots):
            return False
        if any(thing >= 0 and kernel.events[thing].ends for thing, _ in self._things):
            return True
        other = self._turned(at_roots)
        if other is None or not np.array_equal(way.c, other.c):
            return True
        recorded = {i for i, event in enumerate(kernel.events) if event.kink} | {i for i, _ in self._things}
        if other.above - way.above - recorded:
            return True
        met = record["met"][:-1]
        if not all(self._seeded(one, peaks, seed, met) for one in (way, other)):
            return True
        # do the two orders lead to other states or adjoints? The peaks' seed is that of what is behind
        behind = seed * (met == BEHIND)
        bar = np.array(self._record["bar"])
        if behind.any():
            bar -= self._reverse("peaks", way.row, way.x, way.c, behind)[0]
        size = np.abs(bar) @ (np.abs(way.x) + np.abs(self._record["before"]))
        if (np.abs(bar * (way.x - other.x)) > ROUNDING * size).any():
            return True
        a, b, scale = self._back(way, bar), self._back(other, bar), self._kernel.scale
        return (
            _apart(a.x / scale, b.x / scale, a.noise_x / scale)
            or _apart(a.c, b.c, a.noise_c)
            or _apart(np.array([a.t]), np.array([b.t]), a.noise_t)
        )

    def _guards(self, x: Array, c: Array) -> Array:
        return self._f["values"](self._t, x, c)[0] if self._kernel.events else np.empty(0)

    def _rate(self, x: Array, c: Array) -> Array:
        return self._f["dynamics"](self._t, x, c)[0]

    def _begin(self) -> _Way:
        x = np.array(self._record["before"])
        return _Way(x, *self._shown(x, self._c))

    def _shown(self, x: Array, c: Array) -> tuple[Array, Integers]:
        """Constants that show what tables hold there, and the rows."""
        if not self._kernel.tables:
            return c, np.empty(0, dtype=np.int64)
        row, c = self._f["rows"](self._t, x, c)[0].astype(np.int64), c.copy()
        fill(self._kernel.tables, row, c, noise=self._noise)
        return c, row

    def _go(self, way: _Way, thing: int, root: bool) -> None:
        """Let one thing more happen; slopes before it are wanted where it has a time of its own."""
        kernel, after = self._kernel, way.c.copy()
        rate = self._rate(way.x, way.c) if root else np.empty(0)
        way.steps.append(_Step(thing, root, way.x, way.c, way.row, rate, after))
        if thing < 0:
            after[kernel.jumps[-1 - thing]] = -np.inf
        else:
            for place, on in kernel.events[thing].sets:
                after[kernel.switches[place]] = on
            way.x = self._f["update"](self._t, way.x, after, thing)[0]
        way.c, way.row = self._shown(way.x, after)
        way.above |= set(np.flatnonzero(self._guards(way.x, way.c) > 0).tolist())

    def _turned(self, remaining: list[int]) -> _Way | None:
        """Sequence with the given events reversed, the rest as early as possible; None if that fails."""
        remaining, way = remaining.copy(), self._begin()
        rest = [(thing, root) for thing, root in self._things if thing not in remaining]
        while remaining or rest:
            g = self._guards(way.x, way.c)
            ready = [one for one in rest if np.isfinite(g[one[0]]) and (one[1] or g[one[0]] > 0)]
            if ready:
                rest.remove(ready[0])
                self._go(way, *ready[0])
            elif remaining and (remaining[-1] < 0 or np.isfinite(g[remaining[-1]])):
                self._go(way, remaining.pop(), True)
            else:
                return None
        return way

    def _moves(self, step: _Step) -> bool:
        """Whether parameters may move its time."""
        if step.thing < 0:
            return self._kernel.jump_bars[-1 - step.thing] >= 0
        x, c, _, _ = self._root(step)
        return bool(x.any() or c.any())

    def _root(self, step: _Step) -> tuple[Array, Array, float, float]:
        """Derivatives of an event's guard by state, constants and time, and its rate."""
        seed = np.eye(len(self._kernel.events))[step.thing]
        x, c, t = self._reverse("guards", step.row, step.x, step.c, seed)
        return x, c, t, t + float(x @ step.rate)

    def _reverse(self, name: str, row: Integers, *arguments: Any) -> tuple[Array, Array, float]:
        """Bars of state, constants and time by the reverse of a function, where tables showed these rows."""
        x, entries, t = self._f[f"{name}_reverse"](self._t, *arguments)
        c = np.zeros(self._kernel.size("setup_reverse", "cbar"))
        c[: len(entries)] = entries
        gather(self._kernel.tables, row, self._kernel.c_bars, c)
        return x, c, float(t.sum())

    def _seeded(self, way: _Way, peaks: Array, seed: Array, met: Array) -> bool:
        """Give a way the seeds of its peaks; false where they are not those that the rollout met."""
        if not seed.any():
            return True
        states = [(k, step.x, step.c) for k, step in enumerate(way.steps) if k and step.root]
        left, room = seed * (met != 0), ROUNDING * np.abs(peaks)
        for k, x, c in (*states, (len(way.steps), way.x, way.c)):
            m = self._f["dynamics"](self._t, x, c)[1]
            above = (m > peaks + room) | ((m > peaks - room) & (met == 0) & (k < len(way.steps)))
            if (above & (seed != 0)).any():
                return False
            here = np.abs(m - peaks) <= room
            way.seeds[k], left = np.where(here, left, 0.0), np.where(here, 0.0, left)
        return not left.any()

    def _back(self, way: _Way, bar: Array) -> _Bars:
        """Bars before all, from that of the state behind. Each time ends a piece and begins the next."""
        c, rate = np.zeros(self._kernel.size("setup_reverse", "cbar")), self._rate(way.x, way.c)
        noise = ROUNDING * float(np.abs(bar) @ np.abs(rate))
        adjoints = _Bars(bar, c, -float(bar @ rate), np.zeros_like(bar), np.zeros_like(c), noise)
        self._meet(adjoints, way, len(way.steps), (way.row, way.x, way.c))
        for k, step in reversed([*enumerate(way.steps)]):
            if step.thing >= 0:
                x, c, t = self._reverse("update", step.row, step.x, step.after, step.thing, adjoints.x)
                adjoints.x, adjoints.c, adjoints.t = x, adjoints.c + c, adjoints.t + t
            if step.root:
                # from the bar of a thing's own time to what moves it
                rise = float(adjoints.x @ step.rate)
                adjoints.noise_t += ROUNDING * float(np.abs(adjoints.x) @ np.abs(step.rate))
                if step.thing >= 0:
                    by_x, by_c, by_t, slope = self._root(step)
                    mu, noise = -(adjoints.t + rise) / slope, adjoints.noise_t / abs(slope)
                    adjoints.x, adjoints.c, adjoints.t = (
                        adjoints.x + mu * by_x,
                        adjoints.c + mu * by_c,
                        adjoints.t + mu * by_t,
                    )
                    adjoints.noise_x = adjoints.noise_x + noise * abs(by_x)
                    adjoints.noise_c = adjoints.noise_c + noise * abs(by_c)
                else:
                    place = self._kernel.jump_bars[-1 - step.thing]
                    if place >= 0:
                        adjoints.c[place] += adjoints.t + rise
                        adjoints.noise_c[place] += adjoints.noise_t
                    adjoints.t = -rise
                self._meet(adjoints, way, k, (step.row, step.x, step.c))
        return adjoints

    def _meet(self, bars: _Bars, way: _Way, k: int, at: tuple[Integers, Array, Array]) -> None:
        """Take in the seeds of peaks that are met before step k."""
        if k in way.seeds and way.seeds[k].any():
            x, c, t = self._reverse("peaks", *at, way.seeds[k])
            bars.x, bars.c, bars.t = bars.x + x, bars.c + c, bars.t + t


def _apart(a: Array, b: Array, noise: Array | float) -> bool:
    """Whether bars differ by more than derivatives may that are the same."""
    largest = np.abs(a).max(initial=0.0)
    return bool((np.abs(a - b) > SAME * (np.abs(a) + FAINT * largest) + noise).any())


CALLED = ("dynamics", "rows", "values", "update", "guards_reverse", "update_reverse", "peaks_reverse")


def check_orders(kernel: Kernel, p: Array, seed: Array, raw: RolloutArrays) -> None:
    """Doubt gradients where the order of what happens at one instant counts, and nowhere else.

    Args:
        kernel: With the reverse functions.
        p, seed: Parameters (N, np) and weights of the costs (N, nj).
        raw: The rollouts, with the instants that the sweep back told; their doubts are changed.
    """
    instants = raw.instants
    if instants is None or not instants.count.any():
        return
    calls = {name: NumericFunction(kernel.functions[name]) for name in CALLED if name in kernel.functions}
    first, last = kernel.integrals, kernel.integrals + kernel.peaks
    for i in np.flatnonzero(
        raw.completed & (instants.count > 0) & (np.isin(raw.log.gradient_warning[:, 0], (0, COINCIDENT)))
    ):
        c = kernel.functions["setup"](p[i])[1].full().ravel()
        rbar = kernel.functions["objective_reverse"](raw.r[i], p[i], seed[i])[0].full().ravel()
        peaks = (raw.r[i, first:last], rbar[first:last])
        constants = (c, kernel.noise.drawn(p[i : i + 1])[0])
        coincident = [
            CoincidentInstant(kernel, calls, constants, row)
            for row in instants.records[i, : instants.count[i]]
        ]
        counts = (here.event for here in coincident if here.order_counts(*peaks))
        left = -1 if instants.count[i] > len(coincident) else None
        event = next(counts, left)
        raw.log.gradient_warning[i] = (0, 0) if event is None else (COINCIDENT, event)
