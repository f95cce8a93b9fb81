"""Dependence of gradients on the order of coincident events.

Two coincident events, or an event and a coincident jump, may change order when parameters move their times.
A cost is differentiable there only if both orders lead to the same state after them and to the same adjoints
before them. The check needs only data recorded at the instant and is cheap compared with a rollout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacerobot.compiled.numeric_function import NumericFunction
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import (
    COINCIDENT,
    FAINT,
    MAX_OCCURRENCES,
    SAME,
    RolloutArrays,
)
from spacerobot.rollout.tables import Integers, fill, gather

BETWEEN, AFTER = 1, 2
"""Position of a peak at a coincident instant: between two of its events, or after all of them."""

ROUNDING = 1e-9
"""Relative tolerance of a zero sum: part of the sum of the magnitudes of its terms."""


@dataclass(frozen=True)
class _Step:
    """An event or a jump of a coincident instant, with the state before it.

    Attributes:
        index: Index of the event, or -1 - J for jump J.
        root: Whether its time is the root of its own guard, or a jump's time.
        x, c, row: State (nx,), constants (nc,) and rows of the tables before it.
        rate: State derivative before it (nx,), empty unless ``root``.
        after: Constants after it, with the windows of the tables from before it.
    """

    index: int
    root: bool
    x: Array
    c: Array
    row: Integers
    rate: Array
    after: Array


@dataclass
class _Ordering:
    """Coincident events in one order, applied one after the other.

    Attributes:
        x, c, row: State, constants and rows of the tables after the events applied so far.
        steps: Events and jumps applied so far.
        above: Events whose guard was above zero at any point.
        seeds: Adjoints of the peaks (n,) reached before a step, by its number; the last is after all steps.
    """

    x: Array
    c: Array
    row: Integers
    steps: list[_Step] = field(default_factory=list)
    above: set[int] = field(default_factory=set)
    seeds: dict[int, Array] = field(default_factory=dict)


@dataclass
class _Adjoints:
    """Adjoints of state, constants and time, and the rounding error of each."""

    x: Array
    c: Array
    t: float
    noise_x: Array
    noise_c: Array
    noise_t: float


class CoincidentInstant:
    """Coincident events and jumps at one instant of a rollout.

    Args:
        kernel, calls: Kernel with the reverse functions, and these functions as numeric callables.
        constants: Prepared constants of the rollout (nc,), and its random numbers (n,).
        record: Record of the instant, from :class:`.CoincidentInstants`.
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
        number = min(int(record["number"]), MAX_OCCURRENCES)
        reversed_steps = zip(record["occurrence"][:number][::-1], record["root"][:number][::-1], strict=True)
        self._steps_recorded = [(int(index), bool(root)) for index, root in reversed_steps]

    @property
    def event(self) -> int:
        """Index of an event at the instant, -1 if there are only jumps."""
        return max(index for index, _ in self._steps_recorded)

    def order_counts(self, peaks: Array, seed: Array) -> bool:
        """Whether the order affects the gradient of a cost with adjoints ``seed`` (n,) of ``peaks`` (n,)."""
        kernel, record = self._kernel, self._record
        if record["missed"] or record["number"] > MAX_OCCURRENCES:
            return True
        values_before = self._guards(record["before"], self._c)
        at_roots = [
            index
            for index, root in self._steps_recorded
            if root and (index < 0 or np.isfinite(values_before[index]))
        ]
        if len(at_roots) < 2:
            return False
        ordering = self._begin()
        for index, root in self._steps_recorded:
            self._apply(ordering, index, root)
        if not any(self._moves(step) for step in ordering.steps if step.index in at_roots):
            return False
        if any(index >= 0 and kernel.events[index].ends for index, _ in self._steps_recorded):
            return True
        alternative = self._reversed_order(at_roots)
        if alternative is None or not np.array_equal(ordering.c, alternative.c):
            return True
        recorded = {i for i, event in enumerate(kernel.events) if event.kink} | {
            i for i, _ in self._steps_recorded
        }
        if alternative.above - ordering.above - recorded:
            return True
        peak_place = record["met"][:-1]
        if not all(self._set_seeds(order, peaks, seed, peak_place) for order in (ordering, alternative)):
            return True
        # Both orders must give the same state and adjoints. The recorded adjoint includes the seed of
        # peaks after all events, which _back adds itself, so it is subtracted here.
        after_seed = seed * (peak_place == AFTER)
        bar = np.array(self._record["bar"])
        if after_seed.any():
            bar -= self._reverse("peaks", ordering.row, ordering.x, ordering.c, after_seed)[0]
        size = np.abs(bar) @ (np.abs(ordering.x) + np.abs(self._record["before"]))
        if (np.abs(bar * (ordering.x - alternative.x)) > ROUNDING * size).any():
            return True
        a, b, scale = self._back(ordering, bar), self._back(alternative, bar), self._kernel.scale
        return (
            _differ(a.x / scale, b.x / scale, a.noise_x / scale)
            or _differ(a.c, b.c, a.noise_c)
            or _differ(np.array([a.t]), np.array([b.t]), a.noise_t)
        )

    def _guards(self, x: Array, c: Array) -> Array:
        return self._f["values"](self._t, x, c)[0] if self._kernel.events else np.empty(0)

    def _rate(self, x: Array, c: Array) -> Array:
        return self._f["dynamics"](self._t, x, c)[0]

    def _begin(self) -> _Ordering:
        x = np.array(self._record["before"])
        return _Ordering(x, *self._with_windows(x, self._c))

    def _with_windows(self, x: Array, c: Array) -> tuple[Array, Integers]:
        """Constants with the windows of the tables filled for a state, and the rows."""
        if not self._kernel.tables:
            return c, np.empty(0, dtype=np.int64)
        row, c = self._f["rows"](self._t, x, c)[0].astype(np.int64), c.copy()
        fill(self._kernel.tables, row, c, noise=self._noise)
        return c, row

    def _apply(self, ordering: _Ordering, index: int, root: bool) -> None:
        """Apply the next event or jump; ``root`` stores the state derivative before it as well."""
        kernel, after = self._kernel, ordering.c.copy()
        rate = self._rate(ordering.x, ordering.c) if root else np.empty(0)
        ordering.steps.append(_Step(index, root, ordering.x, ordering.c, ordering.row, rate, after))
        if index < 0:
            after[kernel.jumps[-1 - index]] = -np.inf
        else:
            for place, on in kernel.events[index].sets:
                after[kernel.switches[place]] = on
            ordering.x = self._f["update"](self._t, ordering.x, after, index)[0]
        ordering.c, ordering.row = self._with_windows(ordering.x, after)
        ordering.above |= set(np.flatnonzero(self._guards(ordering.x, ordering.c) > 0).tolist())

    def _reversed_order(self, remaining: list[int]) -> _Ordering | None:
        """Sequence with the given events reversed, other steps as early as possible; None if impossible."""
        remaining, ordering = remaining.copy(), self._begin()
        forced = [(index, root) for index, root in self._steps_recorded if index not in remaining]
        while remaining or forced:
            g = self._guards(ordering.x, ordering.c)
            ready = [step for step in forced if np.isfinite(g[step[0]]) and (step[1] or g[step[0]] > 0)]
            if ready:
                forced.remove(ready[0])
                self._apply(ordering, *ready[0])
            elif remaining and (remaining[-1] < 0 or np.isfinite(g[remaining[-1]])):
                self._apply(ordering, remaining.pop(), True)
            else:
                return None
        return ordering

    def _moves(self, step: _Step) -> bool:
        """Whether parameters may move the time of a step."""
        if step.index < 0:
            return self._kernel.jump_bars[-1 - step.index] >= 0
        x, c, _, _ = self._root(step)
        return bool(x.any() or c.any())

    def _root(self, step: _Step) -> tuple[Array, Array, float, float]:
        """Derivatives of an event's guard by state, constants and time, and its rate."""
        seed = np.eye(len(self._kernel.events))[step.index]
        x, c, t = self._reverse("guards", step.row, step.x, step.c, seed)
        return x, c, t, t + float(x @ step.rate)

    def _reverse(self, name: str, row: Integers, *arguments: Any) -> tuple[Array, Array, float]:
        """Adjoints of state, constants and time from a function's reverse, with given rows of the tables."""
        x, entries, t = self._f[f"{name}_reverse"](self._t, *arguments)
        c = np.zeros(self._kernel.size("setup_reverse", "cbar"))
        c[: len(entries)] = entries
        gather(self._kernel.tables, row, self._kernel.c_bars, c)
        return x, c, float(t.sum())

    def _set_seeds(self, ordering: _Ordering, peaks: Array, seed: Array, peak_place: Array) -> bool:
        """Set the seeds of an ordering's peaks; false if its peaks are not those of the rollout."""
        if not seed.any():
            return True
        states = [(k, step.x, step.c) for k, step in enumerate(ordering.steps) if k and step.root]
        remaining_seed, room = seed * (peak_place != 0), ROUNDING * np.abs(peaks)
        for k, x, c in (*states, (len(ordering.steps), ordering.x, ordering.c)):
            m = self._f["dynamics"](self._t, x, c)[1]
            above = (m > peaks + room) | ((m > peaks - room) & (peak_place == 0) & (k < len(ordering.steps)))
            if (above & (seed != 0)).any():
                return False
            reached = np.abs(m - peaks) <= room
            ordering.seeds[k], remaining_seed = (
                np.where(reached, remaining_seed, 0.0),
                np.where(reached, 0.0, remaining_seed),
            )
        return not remaining_seed.any()

    def _back(self, ordering: _Ordering, bar: Array) -> _Adjoints:
        """Adjoints before all steps, from the state's adjoint ``bar`` (nx,) after them.

        The time t_k of a step with its own root ends one piece of the trajectory and starts the next. With
        guard g(t, x, c) = 0 and g' = dg/dt + g_x f, the implicit function theorem gives dt_k = -(dg)/g'. The
        adjoint of t_k before the update is t_bar + x_bar . f, so x_bar, c_bar and t_bar gain mu times the
        guard's derivatives with mu = -(t_bar + x_bar . f) / g'. For a jump, t_k is an entry of c.
        """
        c, rate = np.zeros(self._kernel.size("setup_reverse", "cbar")), self._rate(ordering.x, ordering.c)
        noise = ROUNDING * float(np.abs(bar) @ np.abs(rate))
        adjoints = _Adjoints(bar, c, -float(bar @ rate), np.zeros_like(bar), np.zeros_like(c), noise)
        self._add_peaks(adjoints, ordering, len(ordering.steps), (ordering.row, ordering.x, ordering.c))
        for k, step in reversed([*enumerate(ordering.steps)]):
            if step.index >= 0:
                x, c, t = self._reverse("update", step.row, step.x, step.after, step.index, adjoints.x)
                adjoints.x, adjoints.c, adjoints.t = x, adjoints.c + c, adjoints.t + t
            if step.root:
                # adjoint of the step's time, passed on to the arguments of its guard or to the jump's time
                rise = float(adjoints.x @ step.rate)
                adjoints.noise_t += ROUNDING * float(np.abs(adjoints.x) @ np.abs(step.rate))
                if step.index >= 0:
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
                    place = self._kernel.jump_bars[-1 - step.index]
                    if place >= 0:
                        adjoints.c[place] += adjoints.t + rise
                        adjoints.noise_c[place] += adjoints.noise_t
                    adjoints.t = -rise
                self._add_peaks(adjoints, ordering, k, (step.row, step.x, step.c))
        return adjoints

    def _add_peaks(
        self, adjoints: _Adjoints, ordering: _Ordering, k: int, at: tuple[Integers, Array, Array]
    ) -> None:
        """Add the adjoints of the peaks reached before step k."""
        if k in ordering.seeds and ordering.seeds[k].any():
            x, c, t = self._reverse("peaks", *at, ordering.seeds[k])
            adjoints.x, adjoints.c, adjoints.t = adjoints.x + x, adjoints.c + c, adjoints.t + t


def _differ(a: Array, b: Array, noise: Array | float) -> bool:
    """Whether adjoints differ beyond rounding."""
    largest = np.abs(a).max(initial=0.0)
    return bool((np.abs(a - b) > SAME * (np.abs(a) + FAINT * largest) + noise).any())


CALLED = ("dynamics", "rows", "values", "update", "guards_reverse", "update_reverse", "peaks_reverse")


def check_orders(kernel: Kernel, p: Array, seed: Array, raw: RolloutArrays) -> None:
    """Set the gradient warning where the order of coincident events affects the gradient; clear it elsewhere.

    Args:
        kernel: Kernel with the reverse functions.
        p, seed: Parameters (N, np) and weights of the costs (N, nj).
        raw: Rollouts with the coincident instants that the backward pass recorded; warnings are updated.
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
        counts = (instant.event for instant in coincident if instant.order_counts(*peaks))
        unrecorded = -1 if instants.count[i] > len(coincident) else None
        event = next(counts, unrecorded)
        raw.log.gradient_warning[i] = (0, 0) if event is None else (COINCIDENT, event)
