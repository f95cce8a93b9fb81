"""Interpreted rollouts with events: the steps of ``loops/events.hpp``, one after the other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from spacerobot.rollout.grid import ROUNDING, TimeGrid
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.protocol import Array
from spacerobot.rollout.raw import CHATTERING, COINCIDENT, COMPLETED, DIVERGED, ENDED, GRAZING
from spacerobot.rollout.segments import HERE, Plan, Segment, segments

TOLERANCE, TOGETHER = 1e-12, 1e-9
"""Of an event's time; times within which two events may change places [s]."""

SHORTEST, GRAZES = 1e-4, 1e-3
"""Part of a step after which a guard's peak is looked for; within which a guard that grazes turns back."""

MARGIN = 0.05
"""Part of its bend that a guard's parabola may be wrong."""

SECANTS, TRIES, BURST = 8, 60, 100
"""Lengths tried at peaks, or before they are halved; in all; events in a step that are not yet chattering."""


class Stepper(Protocol):
    """What evaluates steps of a kernel."""

    @property
    def kernel(self) -> Kernel:
        """The kernel."""

    def steps(self, n: int, estimate: bool) -> Any:
        """Function of so many steps, ``(x, t, h, dt, dh, c) -> (x, m, error)``."""


@dataclass(frozen=True)
class Happening:
    """An event of an interpreted rollout.

    Attributes
    ----------
    event
        Which.
    time_s
        When.
    before, after
        States.
    steps
        Steps done before it.
    located
        Whether it fired at its guard's root, at the end of a step; else at once, where one begins.
    first
        What the segment behind it begins with, as in :class:`~spacerobot.rollout.segments.Plan`.
    c
        Constants after it.
    """

    event: int
    time_s: float
    before: Array
    after: Array
    steps: int
    located: bool
    first: int
    c: Array


@dataclass
class _Done:
    """What a step came to; the event it ends with, or -1, and whether it was cut short."""

    end: Array
    m: Array
    error: Array
    length: float
    event: int = -1
    cut: bool = False


@dataclass
class _Bracket:
    """Lengths of a step without and with a guard above its level, and the guards there."""

    low: float
    before: Array
    high: float
    after: Array

    def root(self, i: int, first: float, rate: float) -> float:
        """Root of the polynomial through all that is known of guard i."""
        low, high, before, after = self.low, self.high, self.before[i], self.after[i]
        with np.errstate(all="ignore"):
            chord = np.divide(before - first, low) if low > 0 else 0.0
            rise = (chord - rate) / low if low > 0 else np.divide(np.divide(after - first, high) - rate, high)
            third = ((np.divide(after - before, high - low) - chord) / high - rise) / high if low > 0 else 0.0
            a, b = low, high
            for _ in range(64):
                s = a + (b - a) / 2
                above = first + s * (rate + s * (rise + (s - low) * third)) > 0
                a, b = (a, s) if above else (s, b)
        return b


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
    """

    engine: Stepper
    grid: TimeGrid
    x: Array
    c: Array
    estimate: bool
    fate: int = COMPLETED
    doubt: tuple[int, int] = (0, 0)
    happenings: list[Happening] = field(default_factory=list)
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
        self._begin, self._level = self.x, np.zeros(len(kernel.events))
        self._kinks = np.array([event.kink for event in kernel.events], bool)
        self._fresh, self._last = True, -1
        self._burst, self._since = 0, -np.inf
        self._slope = 0.0  # of the time at which a segment begins that an event began
        self._times = self.c[list(kernel.jumps)].copy()
        self.c[list(kernel.jumps)] = np.where(self._times <= 0, -np.inf, np.inf)
        self.shown.append(self.c.copy())
        self.end_s = 0.0

    def run(self) -> None:
        """Go on to the end."""
        for part in segments(self.grid, self._times):
            if part.first >= 0:
                self.c[self.engine.kernel.jumps[part.first]] = -np.inf
                self._fresh = True
            self._cross(part)
            if self.fate != COMPLETED:
                return
            if part.samples:
                self.sampled.append(len(self.rows))
                self.shown.append(self.c.copy())

    @property
    def plan(self) -> Plan:
        """The steps that were done."""
        t, h, index, number, first, last = (np.array(column) for column in zip(*self.rows, strict=True))
        return Plan(t, h, index, number, first, last, np.array(self.sampled))

    def _longest(self) -> float:
        kernel = self.engine.kernel
        limits = [step_s for place, step_s in kernel.fine if self.c[kernel.switches[place]] != 0]
        return min([self.grid.step_s, *limits])

    def _cross(self, part: Segment) -> None:
        """Steps from the beginning of a segment to its end, cut anew wherever an event is."""
        begin, first, whole = part.begin_s, part.first, self._longest() == self.grid.step_s
        number, h = part.steps, part.length(self.grid)
        if not whole:
            number = self._number(part.end_s - begin)
            h = (part.end_s - begin) / number
        index = 0
        while index < number and self.fate == COMPLETED:
            t = begin + index * h
            row = (index, number, first, part.last)
            if (event := self._at_once(t)) >= 0:
                self._fire(event, t, first, self._moved(row)[0])
                done = None
            else:
                done = self._step(t, h, row, part.end_s)
            index += 1
            if self.fate == COMPLETED and (done is None or done.cut):
                begin = t if done is None else self.end_s
                first = first if done is None else HERE
                number, index = self._number(part.end_s - begin), 0
                h = (part.end_s - begin) / number
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

    def _guards(self, t: float, x: Array, rate: Array) -> Iterator[Array]:
        found = self.engine.kernel.functions["guards"](t, x, self.c, rate)
        return (part.full().ravel() for part in found)

    def _at_once(self, t: float) -> int:
        """The event that fires where a step begins, or -1."""
        rate = self.engine.kernel.functions["dynamics"](t, self.x, self.c)[0].full().ravel()
        self._first, self._rates = [*self._guards(t, self.x, rate)][:2]
        if self._last >= 0:
            self._level[self._last] = max(self._first[self._last], 0.0)
        self._first = self._first - self._level
        above = np.flatnonzero(self._first > 0)
        return int(above[0]) if self._fresh and above.size else -1

    def _step(self, t: float, h: float, row: tuple[int, int, int, int], until_s: float) -> _Done:
        """One step of length h, or one cut short."""
        dt, dh = self._moved(row)
        done = self._tried(t, h, dt, dh)
        slope = dt
        if done.cut:
            done, slope = self._stretched(done, t, dt)
        if not self._sound(done.end):
            self.fate = DIVERGED
            return done
        self.states.append(self.x)
        self.constants.append(self.c.copy())
        self.peaks.append(done.m)
        self.errors.append(np.abs(done.error))
        self.rows.append((t, done.length, *row))
        self.cut.append(done.cut)
        self.x, self._fresh, self._last = done.end, False, -1
        self.end_s = min(t + done.length, until_s)
        if done.event >= 0:
            self._fire(done.event, self.end_s, HERE, slope, located=True)
        elif done.cut:
            self._slope = slope
        return done

    def _sound(self, x: Array) -> bool:
        with np.errstate(over="ignore", invalid="ignore"):
            far = np.sum(((x - self._begin) * self.engine.kernel.scale) ** 2)
        return bool(far < 1)  # false for a NaN as well

    def _evaluated(self, t: float, h: float, dt: float, dh: float) -> tuple[_Done, Array]:
        """A step of length h, and the guards at its end."""
        found = self.engine.steps(1, self.estimate)(self.x, t, h, dt, dh, self.c)
        end, m, error = (value.full().ravel() for value in found)
        g = next(self._guards(t + h, end, np.zeros_like(end))) - self._level
        return _Done(end, m, error, h), g

    def _tried(self, t: float, h: float, dt: float, dh: float) -> _Done:
        """The step, taken with other lengths until no guard is above its level before its end."""
        done, g = self._evaluated(t, h, dt, dh)
        for peaks in range(SECANTS):
            if (g > 0).any() or not self._sound(done.end):
                break
            shorter = self._shortest_peak(g, done.length, GRAZES if peaks else MARGIN)
            if shorter == done.length:
                break
            done, g = self._evaluated(t, shorter, dt, dh)
            done.cut = True
        if (g > 0).any() and self._sound(done.end):
            done, g = self._located(t, _Bracket(0.0, self._first, done.length, g), done, g)
            self._judge(done.event, done.length, g)
        self._level = np.minimum(self._level, np.maximum(g + self._level, 0.0))
        return done

    def _shortest_peak(self, g: Array, h: float, margin: float) -> float:
        """How long a step must be to end at the first peak of a guard that may rise above its level."""
        first, rate = self._first, self._rates
        with np.errstate(all="ignore"):
            bend = (g - first) / h - rate
            s = -rate / bend / 2
            high = (s > SHORTEST) & (s < 1 - GRAZES) & (first + rate * s * h / 2 > margin * h * bend)
            if margin == GRAZES:
                self._doubt(GRAZING, np.flatnonzero(-g < -(GRAZES**2) * h * bend))
        return float((s[high] * h).min(initial=h))

    def _located(self, t: float, bracket: _Bracket, done: _Done, g: Array) -> tuple[_Done, Array]:
        """The step up to the earliest root, where a guard is just above its level, and the guards there."""
        tries = 0
        while True:
            tries += 1
            low, high = bracket.low, bracket.high
            above = np.flatnonzero(bracket.after > 0)
            root = min(bracket.root(int(i), self._first[i], self._rates[i]) for i in above)
            near = high - root <= TOLERANCE or high - low <= TOLERANCE or tries > TRIES
            if near and (g > 0).any():
                done.cut, done.event = True, int(np.flatnonzero(g > 0)[0])
                return done, g
            tried = low + (high - low) / 2 if tries > SECANTS else min(high, max(root, low) + TOLERANCE / 2)
            done, g = self._evaluated(t, high if near else tried, 0.0, 0.0)
            if (g > 0).any():
                bracket.high, bracket.after = done.length, g
            else:
                bracket.low, bracket.before = done.length, g

    def _judge(self, event: int, h: float, g: Array) -> None:
        """Doubts in a gradient through an event at the end of a step of length h."""
        rise = 2 * ((g[event] - self._first[event]) / h - self._rates[event]) / h if h > 0 else 0.0
        turn = GRAZES * self.grid.step_s
        if h > GRAZES * turn and abs(self._rates[event] + rise * h) < turn * abs(rise):
            self._doubt(GRAZING, np.array([event]))
        near = g + TOGETHER * np.maximum(self._rates, 0.0) > 0
        if not self._kinks[event]:
            self._doubt(COINCIDENT, np.flatnonzero(near & (np.arange(len(g)) != event)))

    def _doubt(self, why: int, events: Array | np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        events = events[~self._kinks[events]]
        if len(events) and self.doubt[0] == 0:
            self.doubt = (why, int(events[0]))

    def _stretched(self, done: _Done, t: float, dt: float) -> tuple[_Done, float]:
        """A step cut short whose length moves with its event, and the derivative of the time of its end."""
        rate = self.engine.kernel.rate
        if rate is None:
            return done, dt
        ends = [self._evaluated(t, done.length, dt, dh)[0].end for dh in (0.0, 1.0)]
        stretch = 0.0
        if done.event >= 0:
            slopes = []
            for end, time_slope in zip(ends, (dt, dt + 1.0), strict=True):
                self.c[rate] = time_slope
                slopes.append([*self._guards(t + done.length, end, np.zeros_like(end))][2][done.event])
            self.c[rate] = 0.0
            stretch = -slopes[0] / (slopes[1] - slopes[0])
        done.end = ends[0] + stretch * (ends[1] - ends[0])
        return done, dt + stretch

    def _fire(self, event: int, t: float, first: int, slope: float, *, located: bool = False) -> None:
        """Let an event happen; the time has the given derivative."""
        kernel = self.engine.kernel
        rule = kernel.events[event]
        for place, on in rule.sets:
            self.c[kernel.switches[place]] = on
        if kernel.rate is not None:
            self.c[kernel.rate] = slope
        after = kernel.functions["update"](t, self.x, self.c, event).full().ravel()
        if kernel.rate is not None and not rule.ends:  # final values see what the time does
            self.c[kernel.rate] = 0.0
        if located:
            self._slope = slope
        if not self._sound(after):
            self.fate = DIVERGED
            return
        here = Happening(event, t, self.x, after, len(self.rows), located, first, self.c.copy())
        self.happenings.append(here)
        self.x, self._fresh, self._last = after, True, event
        close = t - self._since <= self.grid.step_s
        self._burst, self._since = (self._burst + 1, self._since) if close else (1, t)
        self.fate = ENDED if rule.ends else CHATTERING if self._burst > BURST else COMPLETED
