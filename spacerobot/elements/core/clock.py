"""Sample instants of periodic elements: sensors, controllers, pulsed thrusters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, TypedDict, Unpack

import casadi as ca
from pydantic import model_validator

from spacerobot.common.section import MAX_SAMPLES, Section, quantity
from spacerobot.elements.core.contribution import State, memory
from spacerobot.elements.core.event import Event
from spacerobot.elements.core.section_context import SectionContext

EARLY = 5e-13
"""Time [s] by which a clock's guard rises early, so that anything else at the same instant, such as an output
sample, comes after it despite rounding."""

ONCE = 1e9
"""Period [s] of a clock that ticks once; longer than any simulation."""

MAX_DELAY = 16
"""Maximum delay in periods, equal to the number of stored values."""


class PeriodicSection(Section):
    """Section of an element that a clock evaluates; its values take effect after a delay."""

    period: float = quantity(
        "s", "time between two instants, the first at the start", gt=0, recurs=MAX_SAMPLES
    )
    delay: float = quantity(
        "s",
        f"time from an instant until its sample is known, or its output acts; at most {MAX_DELAY} periods",
        default=0.0,
        ge=0,
    )

    @model_validator(mode="after")
    def _check_delay(self) -> Self:
        if self.delay > MAX_DELAY * self.period:
            raise ValueError(
                f"delay: found {self.delay:g} s, allowed: at most {MAX_DELAY} periods, "
                f"{MAX_DELAY * self.period:g} s"
            )
        return self


class Marks(TypedDict, total=False):
    """Marks of an event at the instants of a clock, as in :class:`~spacerobot.elements.core.event.Event`."""

    silent: bool
    routine: bool
    quantised: bool
    onboard: bool


@dataclass(frozen=True)
class Clock:
    """Instants ``begin + k period``, k = 0, 1, 2, ..., without accumulated rounding errors.

    Attributes:
        count: State with the number k of the next instant.
        instant: Time of the next instant (1x1) [s].
        guard: Expression that is above zero from the instant on (1x1).
    """

    count: State
    instant: ca.SX
    guard: ca.SX

    @classmethod
    def of(cls, name: str, time: ca.SX, period: ca.SX, begin: ca.SX | float = 0.0) -> Clock:
        """Clock whose state is named after it.

        Args:
            name: Name of the clock, unique in the closed loop.
            time: Present time (1x1) [s].
            period, begin: Time between two instants, and first instant (1x1) [s]; constant over a rollout.
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
    """Shift register of delayed samples, latest first, and the clock that outputs them.

    Sample j acts from t_j + d on. If k samples were taken since, it is at index k of the register. Counting
    the index at run time, instead of fixing it, lets period and delay vary between rollouts.

    Attributes:
        name: Name of the owner of the samples.
        samples, due: Clock of the measurements, and clock of the instants at which they act.
        register, held: States of the waiting samples, and of the acting one (n x 1).
    """

    name: str
    samples: Clock
    due: Clock
    register: State
    held: State

    @classmethod
    def of(cls, name: str, context: SectionContext, samples: Clock, held: State, periods: float) -> DelayLine:
        """Shift register for the delay, with room for one period more.

        Args:
            name: Name, unique in the closed loop.
            context: Context of a section with ``period`` and ``delay``.
            samples, held: Clock of the samples, and state of the acting sample.
            periods: Delay in periods, at the scenario's nominal numbers.
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
        """Event at which the next sample starts to act; NaN if that sample has left the register."""
        size = self.held.symbol.size1()
        since = self.samples.count.symbol - 1 - self.due.count.symbol
        sample = ca.SX.nan(size)
        for k in range(self.register.symbol.size1() // size):
            sample = ca.if_else(since == k, self.register.symbol[k * size : (k + 1) * size], sample)
        return self.due.event(f"{self.name}.{kind}", kind, self.name, {self.held.name: sample}, silent=True)
