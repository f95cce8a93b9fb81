"""Sample instants of what acts periodically: sensors, controllers, pulses of thrusters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from spacerobot.elements.contribution import State, memory
from spacerobot.elements.event import Event

EARLY = 5e-13
"""So long before its instant a clock's guard is above zero [s]: what else is at that instant, as a sample of
the output, then comes after it, whatever rounding makes of both."""


@dataclass(frozen=True)
class Clock:
    """Instants ``begin + k period``, k = 0, 1, 2, ...; none of them accumulates rounding.

    Attributes
    ----------
    count
        The number k of the next one.
    instant
        Its time (1x1) [s].
    guard
        Above zero from it on (1x1).
    """

    count: State
    instant: ca.SX
    guard: ca.SX

    @classmethod
    def of(cls, name: str, time: ca.SX, period: ca.SX, begin: ca.SX | float = 0.0) -> Clock:
        """A clock whose state is named after it.

        Parameters
        ----------
        name
            Its own, unique in the closed loop.
        time
            Now (1x1) [s].
        period, begin
            Between two instants, and the first of them (1x1) [s]; constant over a rollout.
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
        silent: bool = False,
    ) -> Event:
        """What happens at its instants; as for :class:`Event`."""
        counted = {self.count.name: self.count.symbol + 1} | dict(updates)
        rules = dict(sets or {})
        return Event(name, kind, who, self.guard, ca.SX(1), rules, counted, clock=True, silent=silent)
