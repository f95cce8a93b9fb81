"""An explicit Runge-Kutta method of order 8 that stops at events, at samples and where references meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq

from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from tests.oracles.engine.engine import Engine
from tests.oracles.engine.events import armed, happen
from tests.oracles.engine.moment import Event, Moment

POSITION_LIMIT = 1e6
"""Greatest position [m, rad] of a rollout that is not called diverged."""
VELOCITY_LIMIT = 1e4
"""Greatest velocity [m/s, rad/s]; beyond, an adaptive integrator would creep."""
CONTROLLER_LIMIT = 1e12
"""Greatest controller state or work."""
LOOK_S = 0.01
"""Longest time between two looks at guards [s]; what rises above zero for less may be passed by."""
PAST_S = 1e-13
"""First step past a root whose guard rounding leaves below zero [s]; each further one is twice as long."""
CHATTER, CHATTER_S = 100, 1e-3
"""More events than this within this time [s] end a rollout."""


@dataclass(frozen=True)
class Happened:
    """An event.

    Attributes
    ----------
    time_s
        When it was [s].
    name, kind, who
        What it was, as the other engine calls it.
    before, after
        States (nx,).
    impulses
        Of all impacts so far on the target, force and couple (6,), by the grasp's name [N s, N m s].
    """

    time_s: float
    name: str
    kind: str
    who: str
    before: Array
    after: Array
    impulses: Mapping[str, Array]


def _may_meet(event: Event, early: Moment, late: Moment) -> bool:
    """Whether shapes may meet and part again between two looks: a gap closes no faster than they move."""
    if event.speed is None:
        return False
    gaps = -event.guard(early) - event.guard(late)
    speed = max(event.speed(early), event.speed(late))
    return gaps > 0 and event.guard(late) <= 0 and (late.t - early.t) * speed > gaps


class Integrator:
    """Carries the state from sample to sample.

    Attributes
    ----------
    t
        Time of its last good state [s].
    events
        What happened on the way.
    ended, chattering
        Whether an event ended the simulation, and whether there were too many in too short a time.
    """

    def __init__(self, engine: Engine, rtol: float, atol: float) -> None:
        for name, value in (("rtol", rtol), ("atol", atol)):
            if not 0 < value < np.inf:
                raise SpaceRobotError(f"{name} of the integrator is {value}, allowed: above zero and finite")
        self._engine, self._rtol, self._atol = engine, rtol, atol
        self.t, self.x = 0.0, engine.x0
        sizes = [len(part) for part in engine.split(engine.x0)]
        self._limits = np.repeat([POSITION_LIMIT, VELOCITY_LIMIT, CONTROLLER_LIMIT], sizes)
        self._step: float | None = None
        self.events: list[Happened] = []
        self.ended = self.chattering = False

    @property
    def stopped(self) -> bool:
        """Whether an event, or too many, ended the simulation."""
        return self.ended or self.chattering

    def advance(self, until: float) -> tuple[Array | None, float]:
        """Normalised state at a later time, None if it diverges, and a time within the last interval.

        An event may end the simulation before.
        """
        within = until
        if self.t == 0:
            self._settle()
        while self.t < until and not self.stopped:
            stops = [t for t in self._engine.breakpoints if self.t < t < until * (1 - 1e-12)]
            stop = min(stops, default=until)
            within = 0.5 * (self.t + stop)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                good = self._interval(stop, within)
            if not good:
                return None, within
        return self.x, within

    def _settle(self) -> None:
        """Let happen what may at this instant."""
        while not self.stopped:
            moment = Moment(self._engine, self.t, self.x, self.t)
            due = next((event for event in armed(self._engine) if event.guard(moment) > 0), None)
            if due is None:
                return
            self._happen(due)

    def _happen(self, event: Event) -> None:
        moment = Moment(self._engine, self.t, self.x, self.t)
        before = self.x
        self.x = happen(self._engine, event, moment)
        lives = self._engine.mode.lives.items()
        impulses = {name: np.concatenate([life.impulse, life.couple]) for name, life in lives}
        self.events.append(Happened(self.t, event.name, event.kind, event.who, before, self.x, impulses))
        self.ended = event.then is None
        recent = self.events[-CHATTER - 1 :]
        self.chattering = len(recent) > CHATTER and self.t - recent[0].time_s < CHATTER_S
        self._step = None

    def _solver(self, until: float, within: float) -> DOP853:
        """From where it is; its first step as long as the last one would have been."""
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
        """Integrate to a time or an event, without breakpoints on the way; whether the state stays good."""
        solver, watched = self._solver(until, within), armed(self._engine)
        if not np.isfinite(solver.f).all():
            return False
        while solver.status == "running":
            self.t, self.x = solver.t, solver.y
            solver.step()
            if solver.status == "failed" or not self._is_good(solver.y):
                return False
            found = self._first(watched, solver, within) if watched else None
            if found is not None:
                return self._stop_at(*found, within)
        # not the last step, which was cut to fit, but the one that the solver would do next
        self._step = solver.h_abs
        self.t, self.x = until, self._engine.normalise(solver.y)
        return True

    def _first(self, watched: Sequence[Event], solver: DOP853, within: float) -> tuple[Event, float] | None:
        """The first event of the step that a solver did, and about when it is."""
        kept: list[DenseOutput] = []  # costs three rates, and is seldom wanted in a short step

        def dense(t: float) -> Array:
            if not kept:
                kept.append(solver.dense_output())
            return np.asarray(kept[0](t))

        def seen(t: float) -> Moment:
            return Moment(self._engine, t, solver.y if t == solver.t else dense(t), within)

        looks = np.linspace(self.t, solver.t, 2 + int((solver.t - self.t) / LOOK_S))
        waiting = [seen(t) for t in looks[:0:-1]]
        before = Moment(self._engine, self.t, self.x, within)
        while waiting:
            moment, roots = waiting[-1], []
            early, late = before.t, moment.t
            if late - early > PAST_S and any(_may_meet(event, before, moment) for event in watched):
                waiting.append(seen(early + (late - early) / 2))
                continue
            before = waiting.pop()
            for event in watched:
                if event.guard(moment) > 0:

                    def guard(t: float, event: Event = event) -> float:
                        return event.guard(Moment(self._engine, t, dense(t), within))

                    root = early if guard(early) >= 0 else float(brentq(guard, early, late, xtol=1e-14))
                    roots.append((root, event))
            if roots:
                root, event = min(roots, key=lambda pair: pair[0])
                return event, root
        return None

    def _stop_at(self, event: Event, time: float, within: float) -> bool:
        """Integrate anew to just past an event's root, and let it happen; whether the state stays good."""
        if time > self.t:
            solver = self._solver(time, within)
            while solver.status == "running":
                solver.step()
            if solver.status == "failed" or not self._is_good(solver.y):
                return False
            self.t, self.x = time, self._engine.normalise(solver.y)
        past = PAST_S
        while event.guard(Moment(self._engine, self.t, self.x, within)) <= 0 and past < 1e-6:
            self.x = self.x + past * self._rate(self.t, self.x, within)
            self.t, past = self.t + past, 2 * past
        self.x = self._engine.normalise(self.x)
        self._happen(event)
        self._settle()
        return True

    def _rate(self, t: float, x: Array, within: float) -> Array:
        """Rate of the state; NaN where there is none, upon which the solver tries a shorter step."""
        try:
            return self._engine.derivative(t, x, within)
        except np.linalg.LinAlgError:
            return np.full(len(x), np.nan)

    def _is_good(self, x: Array) -> bool:
        return bool((np.abs(x) < self._limits).all())
