"""Interpreted rollouts with events: the steps of ``loops/events.hpp``, one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca
import numpy as np

from spacerobot.numeric_function import NumericFunction
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.event_location import RootBracket, TrialStep
from spacerobot.rollout.interpreted_event import InterpretedEvent
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.methods.tableau import INNER
from spacerobot.rollout.rollout_arrays import (
    AT_END,
    CHATTERING,
    COINCIDENT,
    COMPLETED,
    DIVERGED,
    ENDED,
    GRAZING,
    TOGETHER,
)
from spacerobot.rollout.segments import HERE, Segment, StepPlan, graded, segments
from spacerobot.rollout.tables import Integers, fill
from spacerobot.rollout.time_grid import ROUNDING, TimeGrid


class StepFunctions(Protocol):
    """A kernel and the function that does its steps."""

    @property
    def kernel(self) -> Kernel:
        """Kernel of the rollout."""

    def steps(self, n: int, estimate: bool) -> ca.Function:
        """Function that does a number of steps, with an estimate of their errors or without."""


TOLERANCE = 1e-12
"""Of an event's time [s]."""

SHORTEST, GRAZES = 1e-4, 1e-3
"""Part of a step after which a guard's peak is looked for; within which a guard that grazes turns back."""

EARLY = 5e-13
"""So long before its instant a clock's guard is above zero [s]."""

MARGIN = 0.05
"""Part of its bend that a guard's cubic may be wrong."""

SECANTS, TRIES, BURST = 8, 60, 100
"""Lengths tried at peaks, or before they are halved; in all; events in a step that are not yet chattering."""


@dataclass
class _Done:
    """Result of a step; the event it ends with, or -1, and whether it was cut short."""

    end: Array
    m: Array
    error: Array
    length: float
    event: int = -1
    cut: bool = False
    near: int = 0


@dataclass
class HybridRun:
    """One rollout, while it goes on.

    Attributes
    ----------
    engine
        What evaluates.
    grid
        Steps and samples.
    x, c
        State, and constants with the sides of jumps and the switches.
    estimate
        Whether errors of steps are estimated.
    backwards
        Whether events at one instant fire in the other order; they are then found behind all of them.
    noise
        Random numbers (n,).
    """

    engine: StepFunctions
    grid: TimeGrid
    x: Array
    c: Array
    estimate: bool
    backwards: bool = False
    noise: Array | None = None
    fate: int = COMPLETED
    doubt: tuple[int, int] = (0, 0)
    happenings: list[InterpretedEvent] = field(default_factory=list)
    cut: list[bool] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    constants: list[Array] = field(default_factory=list)
    peaks: list[Array] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    rows: list[tuple[float, float, int, int, int, int]] = field(default_factory=list)
    sampled: list[int] = field(default_factory=lambda: [0])
    shown: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        kernel = self.engine.kernel
        evaluated = ("dynamics", "guards", "values", "update", *(["rows"] if kernel.tables else []))
        self._f = {name: NumericFunction(kernel.functions[name]) for name in evaluated}
        self._one_step = NumericFunction(self.engine.steps(1, self.estimate))
        self._begin, self._level = self.x, np.zeros(len(kernel.events))
        self._kinks = np.array([event.kink for event in kernel.events], bool)
        self._gaps, self._speeds = list(kernel.gaps), np.zeros(len(kernel.gaps))
        self._clocks = np.array([event.clock for event in kernel.events], bool)
        self._fixed = ~np.array(kernel.moving or [True] * len(kernel.events), bool)
        self._carried = False  # whether the next segment begins where an event was
        self._fresh, self._last = True, -1
        self._crossed = np.zeros(len(kernel.events), bool)  # what rose in the last step, with an event
        self._burst, self._since = 0, -np.inf
        self._slope = 0.0  # of the time at which a segment begins that an event began
        self._on, self._off = np.zeros(len(kernel.fine)), np.full(len(kernel.fine), np.inf)
        self._times = self.c[list(kernel.jumps)].copy()
        self.c[list(kernel.jumps)] = np.where(self._times <= 0, -np.inf, np.inf)
        self.row, self.shown_rows = np.zeros(0, dtype=np.int64), list[Integers]()
        self._look_up(0.0)
        self.shown.append(self.c.copy())
        self.end_s = 0.0

    def run(self) -> None:
        """Go on to the end."""
        for part in segments(self.grid, self._times, backwards=self.backwards):
            if part.first >= 0:
                self.c[self.engine.kernel.jumps[part.first]] = -np.inf
                self._fresh = True
                self._look_up(part.begin_s)
            self._cross(part)
            if self.fate != COMPLETED:
                return
            if part.samples:
                self.sampled.append(len(self.rows))
                self.shown.append(self.c.copy())

    @property
    def plan(self) -> StepPlan:
        """The steps that were done."""
        t, h, index, number, first, last = (np.array(column) for column in zip(*self.rows, strict=True))
        return StepPlan(t, h, index, number, first, last, np.array(self.sampled))

    def _look_up(self, t: float) -> None:
        """Let windows show the rows that hold from here on."""
        kernel = self.engine.kernel
        if kernel.tables:
            self.row = self._f["rows"](t, self.x, self.c)[0].astype(np.int64)
            fill(kernel.tables, self.row, self.c, kernel.c_slopes, self.noise)

    def _longest(self) -> float:
        kernel = self.engine.kernel
        limits = [step_s for place, step_s, _ in kernel.fine if self.c[kernel.switches[place]] != 0]
        return min([self.grid.step_s, *(self.grid.finer * step_s for step_s in limits)])

    def _cross(self, part: Segment) -> None:
        """Steps from the beginning of a segment to its end, cut anew wherever an event is."""
        begin, first, whole = part.begin_s, part.first, self._longest() == self.grid.step_s
        first, self._carried = HERE if self._carried and first < 0 else first, False
        number, h = part.steps, part.length(self.grid)
        if not whole:
            number = self._number(part.end_s - begin)
            h = (part.end_s - begin) / number
        index = 0
        while index < number and self.fate == COMPLETED:
            t = begin + index * h
            row = (index, number, first, part.last)
            # the event that fires where a step begins, or -1: what another armed before what rose by itself
            rate = self._f["dynamics"](t, self.x, self.c)[0]
            self._first, self._rates = self._f["guards"](t, self.x, self.c, rate)[:2]
            if self._fresh and self._gaps:
                self._speeds = self._values(t, self.x)[1]
            if self._last >= 0:
                self._level[self._last] = max(self._first[self._last], 0.0)
            self._first = self._first - self._level
            if not self._fresh:
                event = -1
            else:
                armed = self._first_above(np.where(self._crossed, -1.0, self._first))
                event = armed if armed >= 0 else self._first_above(self._first)
            if event >= 0 and not self._crossed[event]:
                self._fire(event, t, first, self._moved(row)[0])
                done = None
            else:
                done = self._step(t, h, row, part.end_s, event)
            index += 1
            if self.fate == COMPLETED and (done is None or done.cut):
                begin = t if done is None else self.end_s
                first = first if done is None else HERE
                number, index = self._number(part.end_s - begin), 0
                h = (part.end_s - begin) / number
                # carried over an instant at which clocks leave nothing to happen
                ended = first == HERE and begin >= part.end_s and part.last < 0 and self._clocks.any()
                if ended and not (self._values(begin, self.x)[0] > self._level).any():
                    self._carried = True
                    return
        if self.fate == COMPLETED:
            self.end_s = part.end_s

    def _number(self, length_s: float) -> int:
        return max(1, math.ceil(length_s / self._longest() * (1 - ROUNDING)))

    def _moved(self, row: tuple[int, int, int, int]) -> tuple[float, float]:
        """Derivatives of a step's beginning and length along the direction of a sensitivity."""
        index, number, first, last = row
        places = self.engine.kernel.jump_slopes

        def slope(jump: int) -> float:
            return 0.0 if jump < 0 or not places or places[jump] < 0 else float(self.c[places[jump]])

        begin = self._slope if first == HERE else slope(first)
        dh = (slope(last) - begin) / number
        return begin + index * dh, dh

    def _values(self, t: float, x: Array) -> tuple[Array, Array]:
        """Guards, and bounds of the rates of gaps."""
        g, speed = self._f["values"](t, x, self.c)
        return g, speed

    def _first_above(self, g: Array) -> int:
        """The first event whose guard is above zero, or -1; backwards the one that rose last."""
        above = np.flatnonzero(g > 0)
        if above.size < 2 or not self.backwards:
            return int(above[0]) if above.size else -1
        rising = self._rates[above] > 0
        since = np.where(rising, g[above] / np.where(rising, self._rates[above], 1.0), np.inf)
        return int(above[since <= since.min() + TOLERANCE][-1])

    def _step(self, t: float, h: float, row: tuple[int, int, int, int], until_s: float, own: int) -> _Done:
        """One step of length h, or one cut short: to the root, where it begins, of event `own`."""
        dt, dh = self._moved(row)
        # how long the step may be where a switch is turned on or off nearby
        kernel, shorter = self.engine.kernel, h
        for (place, step_s, grow), on, off in zip(kernel.fine, self._on, self._off, strict=True):
            if grow > 0 and self.c[kernel.switches[place]] != 0:
                own_s = self.grid.finer * step_s
                window = grow * (own_s if own_s < np.inf else self.grid.step_s)
                near = min(t - on, max(off - t, 0.0)) / window
                allowed = graded(min(self.grid.step_s, own_s), window, near)
                shorter = allowed if shorter > allowed * (1 + ROUNDING) else shorter
        # it passes no clock's instant
        past = (TOGETHER if self.backwards else EARLY) + 4 * 2.2e-16 * t
        left = past - self._first[self._clocks & (self._first <= 0)]
        nearest = float(left.min(initial=np.inf))
        shorter = nearest if nearest < shorter - TOLERANCE else shorter
        short = shorter < h
        if own < 0:
            done = self._tried(t, shorter, dt, 0.0 if short else dh)
        else:
            done, _ = self._evaluated(t, 0.0, dt, 0.0)
            done.cut, done.event = True, own
            self._crossed[own] = False
            self._off[:] = np.inf
        done.cut = done.cut or short
        slope = dt
        rate = kernel.rate
        if done.cut and rate is not None:
            # its length moves with its event: stretched, and the derivative of the time of its end
            steps = [self._evaluated(t, done.length, dt, dh)[0] for dh in (0.0, 1.0)]
            ends, done.m = [step.end for step in steps], steps[0].m
            stretch = 0.0
            if done.event >= 0:
                slopes = []
                for end, time_slope in zip(ends, (dt, dt + 1.0), strict=True):
                    self.c[rate] = time_slope
                    found = self._f["guards"](t + done.length, end, self.c, np.zeros_like(end))
                    slopes.append(found[2][done.event])
                self.c[rate] = 0.0
                stretch = -slopes[0] / (slopes[1] - slopes[0])
            done.end = ends[0] + stretch * (ends[1] - ends[0])
            slope = dt + stretch
        if not self._sound(done.end):
            self.fate = DIVERGED
            return done
        self.states.append(self.x)
        self.constants.append(self.c.copy())
        self.shown_rows.append(self.row)
        self.peaks.append(done.m)
        self.errors.append(np.abs(done.error))
        self.rows.append((t, done.length, *row))
        self.cut.append(done.cut)
        self.x, self._fresh, self._last = done.end, False, -1
        self.end_s = min(t + done.length, until_s)
        if done.event >= 0:
            self._fire(done.event, self.end_s, HERE, slope, near=done.near)
        elif done.cut:
            self._slope = slope
        return done

    def _sound(self, x: Array) -> bool:
        with np.errstate(over="ignore", invalid="ignore"):
            far = np.sum(((x - self._begin) * self.engine.kernel.scale) ** 2)
        return bool(far < 1)  # false for a NaN as well

    def _evaluated(self, t: float, h: float, dt: float, dh: float) -> tuple[_Done, TrialStep]:
        """A step of length h, and the guards along it."""
        end, m, error, powers = self._one_step(self.x, t, h, dt, dh, self.c)
        begin, level = self.x, self._level

        def inside(part: float) -> tuple[Array, Array]:
            g, speed = self._values(t + part * h, begin + powers @ part ** np.arange(1, 5))
            return g - level, speed

        g, speed = self._values(t + h, end)
        looks = [inside(part) for part in INNER]
        speeds = np.array([self._speeds, *(own for _, own in looks), speed])
        tried = TrialStep(
            self._first,
            self._rates,
            np.array([own for own, _ in looks]),
            g - level,
            self._gaps,
            h * speeds,
            inside,
        )
        return _Done(end, m, error, h), tried

    def _tried(self, t: float, h: float, dt: float, dh: float) -> _Done:
        """The step, taken with other lengths until no guard is above its level before its end."""
        done, seen = self._evaluated(t, h, dt, dh)
        clear = 0.0  # length of the step within which no gap closes
        for peaks in range(TRIES + 1):
            if not self._sound(done.end):
                return done
            # it ends at the first peak of a guard that may rise above its level
            s, peak, bend = seen.peaks()
            margin = GRAZES if peaks else MARGIN
            with np.errstate(all="ignore"):
                high = (s > SHORTEST) & (s < 1 - GRAZES) & (s * done.length > TOLERANCE)
                high &= peak > -margin * bend
                near = (abs(s - 1) < 10 * GRAZES) & (seen.end <= 0) & (-seen.end < GRAZES**2 * bend)
            if peaks:
                self._doubt(GRAZING, np.flatnonzero(near))
            half = done.length / 2 if done.length > TOLERANCE and seen.unsure().any() else done.length
            shorter = float((s[high] * done.length).min(initial=half))
            meets, sure = (1.0, False) if done.length <= max(clear, TOLERANCE) else seen.meets()
            clear = meets * done.length if sure else clear
            skipped = meets < (1 - GRAZES if seen.rise else 1)
            shorter = min(shorter, meets * done.length) if skipped else shorter
            if shorter == done.length or peaks >= (TRIES if skipped else SECANTS):
                break
            done, seen = self._evaluated(t, shorter, dt, dh)
            done.cut = True
        if seen.rise:
            done, seen = self._located(t, RootBracket(0.0, self._first, done.length, seen.end), done, seen)
            done.near = self._judge(done.event, done.length, seen)
        # a gradient is doubted where parameters move an event at the rollout's end, or just behind it
        kernel = self.engine.kernel
        if kernel.moving and t + done.length >= self.grid.duration_s - TOGETHER:
            with np.errstate(invalid="ignore"):
                late = seen.end + TOGETHER * np.maximum(self._rates, 0.0) > 0
            self._doubt(AT_END, np.flatnonzero(late & np.array(kernel.moving)))
        self._speeds = seen.reach[-1] / done.length if done.length > 0 else self._speeds
        self._crossed = seen.end > 0
        self._crossed[done.event] &= done.event < 0
        self._level = np.minimum(self._level, np.maximum(seen.end + self._level, 0.0))
        for i, (place, _, _) in enumerate(kernel.fine):
            left = seen.left(done.length)
            ends = [left[e] for e, rule in enumerate(kernel.events) if (place, False) in rule.sets]
            self._off[i] = t + done.length + min(ends, default=np.inf)
        return done

    def _located(
        self, t: float, bracket: RootBracket, done: _Done, seen: TrialStep
    ) -> tuple[_Done, TrialStep]:
        """The step up to the earliest root, where a guard is just above its level, and the guards there."""
        tries, tolerance = 0, 2 * TOGETHER if self.backwards else TOLERANCE
        while True:
            tries += 1
            low, high, root = bracket.low, bracket.high, bracket.earliest(seen)
            near = high - root <= tolerance or high - low <= tolerance or tries > TRIES
            if near and seen.rise:
                done.cut, done.event = True, self._first_above(seen.end)
                return done, seen
            tried = low + (high - low) / 2 if tries > SECANTS else min(high, max(root, low) + tolerance / 2)
            done, seen = self._evaluated(t, high if near else tried, 0.0, 0.0)
            if seen.rise:
                bracket.high, bracket.after = done.length, seen.end
            else:
                bracket.low, bracket.before = done.length, seen.end

    def _judge(self, event: int, h: float, seen: TrialStep) -> int:
        """Doubts in a gradient through an event at the end of a step of length h; how many are close."""
        g = seen.end
        rise = 2 * ((g[event] - self._first[event]) / h - self._rates[event]) / h if h > 0 else 0.0
        turn = GRAZES * self.grid.step_s
        if h > GRAZES * turn and abs(self._rates[event] + rise * h) < turn * abs(rise):
            self._doubt(GRAZING, np.array([event]))
        near = g + TOGETHER * np.maximum(self._rates, 0.0) > 0
        near[event] = False
        near &= ~(self._fixed & self._fixed[event])
        others = np.flatnonzero(near & ~self._kinks & ~self._kinks[event])
        self._doubt(COINCIDENT, others)
        return len(others)

    def _doubt(self, why: int, events: Array | np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        events = events[~self._kinks[events]]
        if len(events) and (self.doubt[0] == 0 or (self.doubt[0] == COINCIDENT and why != COINCIDENT)):
            self.doubt = (why, int(events[0]))

    def _fire(self, event: int, t: float, first: int, slope: float, near: int | None = None) -> None:
        """Let an event happen; the time has the given derivative, and so many are close to its root."""
        kernel = self.engine.kernel
        rule = kernel.events[event]
        for place, on in rule.sets:
            self.c[kernel.switches[place]] = on
        for i, (place, _, _) in enumerate(kernel.fine):
            if (place, True) in rule.sets:
                self._on[i], self._off[i] = t, np.inf
        if kernel.rate is not None:
            self.c[kernel.rate] = slope
        after = self._f["update"](t, self.x, self.c, event)[0]
        if kernel.rate is not None and not rule.ends:  # final values see what the time does
            self.c[kernel.rate] = 0.0
        if near is not None:
            self._slope = slope
        if not self._sound(after):
            self.fate = DIVERGED
            return
        now = near is not None, first, self.c.copy(), self.row, near or 0
        self.happenings.append(InterpretedEvent(event, t, self.x, after, len(self.rows), *now))
        self.x, self._fresh, self._last = after, True, event
        self._look_up(t)
        if rule.clock:
            return
        close = t - self._since <= self.grid.step_s
        self._burst, self._since = (self._burst + 1, self._since) if close else (1, t)
        self.fate = ENDED if rule.ends else CHATTERING if self._burst > BURST else COMPLETED
