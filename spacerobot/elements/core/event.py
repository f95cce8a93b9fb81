"""Events: instants, found by their guards, at which switches turn and states take other values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca


@dataclass(frozen=True)
class Event:
    """Event that fires where a guard rises above zero.

    Switches are numbers in c, 0 or 1, constant between events; ``context.switch`` makes them.

    Attributes:
        name: Name of the event, ``left.captured``.
        kind, who: What happened, for people: ``captured``, and to what: ``left``.
        guard: Fires where it is above zero while armed; an expression of (t, x, c) (1x1).
        armed: Whether it may fire: 1 or 0, an expression of switches alone (1x1).
        sets: New values of switches, by the names of their symbols.
        updates: New values of states by name, expressions of (t, x, c): x as before the event, switches in c
            as afterwards (n x 1).
        impact: Whether velocities jump so that no rigid connection that is active afterwards slips: a plastic
            impact.
        loss: Energy [J] that the event takes beside an impact's, an expression as in ``updates`` (1x1), or
            None.
        ends: Whether the rollout is over.
        kink: Whether it only marks where a law is not smooth, so that an integrator may step over it.
        speed: Where the guard is minus a gap between two bodies: an upper bound (1x1) [m/s] of the gap's
            rate, whatever their surfaces are like where they are nearest; else None. Integrators then miss no
            contact between two evaluations of the gap.
        clock: Whether its guard is time less an instant that events alone change, as that of
            :class:`~spacerobot.elements.core.clock.Clock`: steps then end there without root finding.
        silent: Whether it is not recorded; for a clock that turns no switch.
        routine: Whether it recurs by design, as pulses and samples do: batches do not record it.
        quantised: Whether its updates, or the instants that they set, have steps in what they depend on.
        onboard: Whether software on board does it, although an actuator brings it: tests of residuals, and
            decisions on pulses.
    """

    name: str
    kind: str
    who: str
    guard: ca.SX
    armed: ca.SX
    sets: Mapping[str, bool] = field(default_factory=dict)
    updates: Mapping[str, ca.SX] = field(default_factory=dict)
    impact: bool = False
    loss: ca.SX | None = None
    ends: bool = False
    kink: bool = False
    speed: ca.SX | None = None
    clock: bool = False
    silent: bool = False
    routine: bool = False
    quantised: bool = False
    onboard: bool = False


def both(*conditions: ca.SX) -> ca.SX:
    """Whether all hold, of switches or other truth values (1x1 each)."""
    conjunction = ca.SX(1)
    for condition in conditions:
        conjunction = ca.logic_and(conjunction, condition)
    return conjunction


def either(*conditions: ca.SX) -> ca.SX:
    """Whether any holds (1x1 each)."""
    disjunction = ca.SX(0)
    for condition in conditions:
        disjunction = ca.logic_or(disjunction, condition)
    return disjunction


def negated(condition: ca.SX) -> ca.SX:
    """Whether it does not hold (1x1)."""
    return ca.logic_not(condition)
