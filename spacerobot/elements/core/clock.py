"""Sample instants of what acts periodically: sensors, controllers, pulses of thrusters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypedDict, Unpack

import casadi as ca

from spacerobot.elements.core.contribution import State, memory
from spacerobot.elements.core.event import Event
from spacerobot.elements.core.section_context import SectionContext

EARLY = 5e-13
"""So long before its instant a clock's guard is above zero [s]: what else is at that instant, as a sample of
the output, then comes after it, whatever rounding makes of both."""

ONCE = 1e9
"""Period [s] of a clock that ticks once; it is longer than any simulation."""

MAX_DELAY = 16
"""Longest delay, in periods: as many values are held."""


class Marks(TypedDict, total=False):
    """Marks of an event at the instants of a clock, as in :class:`~spacerobot.elements.core.event.Event`."""

    silent: bool
    routine: bool
    quantised: bool
    onboard: bool


@dataclass(frozen=True)
class Clock:
    """Instants ``begin + k period``, k = 0, 1, 2, ...; none of them accumulates rounding.

    Attributes:
        count: The number k of the next one.
        instant: Time of the instant (1x1) [s].
        guard: Above zero from it on (1x1).
    """

    count: State
    instant: ca.SX
    guard: ca.SX

    @classmethod
    def of(cls, name: str, time: ca.SX, period: ca.SX, begin: ca.SX | float = 0.0) -> Clock:
        """A clock whose state is named after it.

        Args:
            name: Name of the clock, unique in the closed loop.
            time: Now (1x1) [s].
            period, begin: Between two instants, and the first of them (1x1) [s]; constant over a rollout.
        """
        count = memory(f"{name}.count", ca.SX.zeros(1))
        instant = begin + count.symbol * period
        return cls(count, instant, time - instant + EARLY)

    def event(
        self,
        name: str,
        kind: str,
        who: str,
        updates: Mapping[str, ca.SX],
        sets: Mapping[str, bool] | None = None,
        **marks: Unpack[Marks],
    ) -> Event:
        """Event at its instants; as for :class:`Event`."""
        counted = {self.count.name: self.count.symbol + 1} | dict(updates)
        return Event(name, kind, who, self.guard, ca.SX(1), dict(sets or {}), counted, clock=True, **marks)


@dataclass(frozen=True)
class DelayLine:
    """Samples that wait, the latest first, and the clock that hands them on.

    Sample j acts from t_j + d on. When it is due, k samples were taken since, and it stands at place k of the
    register. That the place is counted, and not given, lets period and delay be varied.

    Attributes:
        name: Name of the owner of the samples.
        samples, due: Times of the samples, and times at which they act.
        register, held: Samples that wait, and the one that acts (n x 1).
    """

    name: str
    samples: Clock
    due: Clock
    register: State
    held: State

    @classmethod
    def of(cls, name: str, context: SectionContext, samples: Clock, held: State, periods: float) -> DelayLine:
        """Room for a delay, and for one that is up to a period longer.

        Args:
            name: Unique in the closed loop.
            context: Context of a section with ``period`` and ``delay``.
            samples, held: The clock of the samples, and what acts.
            periods: The delay in periods, at the scenario's numbers.
        """
        due = Clock.of(f"{name}.outputs", context.time, context.steady("period"), context.steady("delay"))
        places = math.floor(periods * (1 + 1e-9)) + 2
        register = memory(f"{name}.waiting", ca.repmat(held.initial, places, 1))
        return cls(name, samples, due, register, held)

    @property
    def states(self) -> list[State]:
        """States of the register and of its clock."""
        return [self.register, self.due.count]

    def shifted(self, value: ca.SX) -> dict[str, ca.SX]:
        """The register with one sample more."""
        size = self.held.symbol.size1()
        return {self.register.name: ca.vertcat(value, self.register.symbol[:-size])}

    def event(self, kind: str) -> Event:
        """The next sample acts from now on; one that left the register gives no number."""
        size = self.held.symbol.size1()
        since = self.samples.count.symbol - 1 - self.due.count.symbol
        sample = ca.SX.nan(size)
        for k in range(self.register.symbol.size1() // size):
            sample = ca.if_else(since == k, self.register.symbol[k * size : (k + 1) * size], sample)
        return self.due.event(f"{self.name}.{kind}", kind, self.name, {self.held.name: sample}, silent=True)
