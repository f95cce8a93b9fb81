"""Explicit Runge-Kutta method of order 8 that stops at events, samples and ends of reference segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.pinocchio_engine.closed_loop import PinocchioLoop

POSITION_LIMIT = 1e6
"""Magnitude of a position [m, rad] above which a rollout has diverged."""
VELOCITY_LIMIT = 1e4
"""Magnitude of a velocity [m/s, rad/s] above which a rollout has diverged; step sizes would become tiny."""
CONTROLLER_LIMIT = 1e12
"""Magnitude of a controller state or work above which a rollout has diverged."""
LOOK_S = 0.01
"""Maximum time between two evaluations of guards [s]; a guard other than a gap may be positive unnoticed for
less."""
DEEP = 1e-6
"""Depth [m] above which no contact is missed."""
PAST_S = 1e-13
"""First step past a root at which rounding leaves the guard negative [s]; each further step is twice as
long."""
EARLY = 5e-13
"""Time before its instant at which a clock's guard becomes positive [s]."""
CHATTER, CHATTER_S = 100, 1e-3
"""Number of events within a time [s] above which a rollout ends."""


@dataclass(frozen=True)
class LocatedEvent:
    """Event at its located time.

    Attributes:
        time_s: Time of the event [s].
        name, kind, who: Name, kind and element of the event, as in the closed loop.
        before, after: States before and after the event (nx,).
    """

    time_s: float
    name: str
    kind: str
    who: str
    before: Array
    after: Array


class Integrator:
    """Integrator of the state from sample to sample.

    Attributes:
        t: Time of the last valid state [s].
        events: Events so far.
        ended, chattering: Whether an event ended the simulation, and whether too many events occurred in too
            short a time.
    """

    def __init__(self, engine: PinocchioLoop, rtol: float, atol: float) -> None:
        for name, value in (("rtol", rtol), ("atol", atol)):
            if not 0 < value < np.inf:
                raise SpaceRobotError(f"{name} of the integrator is {value}, allowed: above zero and finite")
        self._engine, self._rtol, self._atol = engine, rtol, atol
        self.t, self.x = 0.0, engine.x0
        sizes = [len(part) for part in engine.split(engine.x0)]
        self._limits = np.repeat([POSITION_LIMIT, VELOCITY_LIMIT, CONTROLLER_LIMIT], sizes)
        self._step: float | None = None
        self.events: list[LocatedEvent] = []
        self.ended = self.chattering = False

    @property
    def stopped(self) -> bool:
        """Whether an event, or chattering, ended the simulation."""
        return self.ended or self.chattering

    def change(self, x: Array) -> None:
        """Continue from another state (nx,)."""
        if not np.array_equal(x, self.x):
            self.x, self._step = np.array(x), None

    def advance(self, until: float) -> tuple[Array | None, float]:
        """Normalised state at a later time, None if it diverges, and a time within the last interval.

        An event may end the simulation earlier.
        """
        within = until
        if self.t == 0:
            self._settle()
        while self.t < until and not self.stopped:
            stops = [t for t in self._engine.breakpoints if self.t < t < until * (1 - 1e-12)]
            clocks = [number for number in self._engine.armed if self._engine.events[number].clock]
            if clocks:
                left = -self._engine.guards(self.t, self.x, self.t)[clocks]
                stops += [min(t, until) for t in self.t + left + EARLY if self.t < t <= until + EARLY]
            stop = min(stops, default=until)
            within = 0.5 * (self.t + stop)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                good = self._interval(stop, within)
            if not good:
                return None, within
            if clocks and self.t == stop:
                self._settle(within)
        return self.x, within

    def _settle(self, within: float | None = None) -> None:
        """Apply all events due at this instant; clocks see references as within an interval, if given."""
        while not self.stopped:
            guards = self._engine.guards(self.t, self.x, self.t)
            due = next((number for number in self._engine.armed if guards[number] > 0), None)
            if due is None:
                return
            self._happen(int(due), within)

    def _happen(self, number: int, within: float | None = None) -> None:
        before, event = self.x, self._engine.events[number]
        self.x = self._engine.happen(number, self.t, self.x, within if event.clock else None)
        self.events.append(LocatedEvent(self.t, event.name, event.kind, event.who, before, self.x))
        self.ended = event.ends
        recent = self.events[-CHATTER - 1 :]
        self.chattering = not event.clock and len(recent) > CHATTER and self.t - recent[0].time_s < CHATTER_S
        self._step = None

    def _solver(self, until: float, within: float) -> DOP853:
        """Solver that continues from the current state with the last step size."""
        first = None if self._step is None else min(self._step, until - self.t)
        return DOP853(
            lambda t, x: self._rate(t, x, within),
            self.t,
            self.x,
            until,
            rtol=self._rtol,
            atol=self._atol,
            first_step=first,
        )

    def _interval(self, until: float, within: float) -> bool:
        """Integrate to a time or an event, without breakpoints between; return whether the state is valid."""
        solver = self._solver(until, within)
        watched = [number for number in self._engine.armed if not self._engine.events[number].clock]
        if not np.isfinite(solver.f).all():
            return False
        while solver.status == "running":
            self.t, self.x = solver.t, solver.y
            solver.step()
            if solver.status == "failed" or not self._is_good(solver.y):
                return False
            event = self._first(watched, solver, within) if watched else None
            if event is not None:
                return self._stop_at(*event, within)
        # not the last step, which was cut to fit, but the one that the solver would do next
        self._step = solver.h_abs
        self.t, self.x = until, self._engine.normalise(solver.y)
        return True

    def _first(self, watched: Sequence[int], solver: DOP853, within: float) -> tuple[int, float] | None:
        """Number of the first event in the solver's last step, and its approximate time."""
        outputs: list[DenseOutput] = []  # costs three rates, and is seldom wanted in a short step

        def state(t: float) -> Array:
            if t in (self.t, solver.t):
                return self.x if t == self.t else np.asarray(solver.y)
            if not outputs:
                outputs.append(solver.dense_output())
            return np.asarray(outputs[0](t))

        def guards(t: float) -> Array:
            return self._engine.guards(t, state(t), within)

        looks = np.linspace(self.t, solver.t, 2 + int((solver.t - self.t) / LOOK_S))
        early, waiting = self.t, list(looks[:0:-1])
        while waiting:
            late = waiting[-1]
            if late - early > PAST_S and self._may_meet(state(early), state(late), late - early):
                waiting.append(early + (late - early) / 2)
                continue
            waiting.pop()
            roots, guard_values = list[tuple[float, int]](), guards(late)
            for number in watched:
                if guard_values[number] > 0:

                    def guard(t: float, number: int = number) -> float:
                        return float(guards(t)[number])

                    root = early if guard(early) >= 0 else float(brentq(guard, early, late, xtol=1e-14))
                    roots.append((root, int(number)))
            if roots:
                root, number = min(roots, key=lambda pair: pair[0])
                return number, root
            early = late
        return None

    def _may_meet(self, early: Array, late: Array, time: float) -> bool:
        """Whether shapes may touch and separate between two guard evaluations, deeper than ``DEEP``.

        With gaps a and b at both ends of a time T and a bound of the rate, the gap between them is at least
        (a + b - rate T) / 2. The bound between the ends is the larger of those at the ends plus their
        difference.
        """
        if not self._engine.scene.contacts:
            return False
        (first, fast), (last, speed) = self._engine.gaps(early), self._engine.gaps(late)
        reach = time * (np.maximum(fast, speed) + np.abs(fast - speed))
        return bool(((first > 0) & (last >= 0) & (reach > first + last + 2 * DEEP)).any())

    def _stop_at(self, number: int, time: float, within: float) -> bool:
        """Integrate to just past an event's root and apply the event; return whether the state is valid."""
        if time > self.t:
            solver = self._solver(time, within)
            while solver.status == "running":
                solver.step()
            if solver.status == "failed" or not self._is_good(solver.y):
                return False
            self.t, self.x = time, self._engine.normalise(solver.y)
        past = PAST_S
        while self._engine.guards(self.t, self.x, within)[number] <= 0 and past < 1e-6:
            self.x = self.x + past * self._rate(self.t, self.x, within)
            self.t, past = self.t + past, 2 * past
        self.x = self._engine.normalise(self.x)
        self._happen(number)
        self._settle()
        return True

    def _rate(self, t: float, x: Array, within: float) -> Array:
        """Rate of the state; NaN if it cannot be computed, so that the solver tries a shorter step."""
        try:
            return self._engine.derivative(t, x, within)
        except np.linalg.LinAlgError:
            return np.full(len(x), np.nan)

    def _is_good(self, x: Array) -> bool:
        return bool((np.abs(x) < self._limits).all())
