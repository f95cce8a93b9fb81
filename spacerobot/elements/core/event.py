"""Events: instants, located by guards, at which switches and states take new values."""

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
        kind, who: Kind of event (``captured``) and the part to which it happens (``left``), for messages.
        guard: Expression of (t, x, c) (1x1); the event fires where it is above zero while armed.
        armed: Whether it may fire: 1 or 0, an expression of switches only (1x1).
        sets: New values of switches, by the names of their symbols.
        updates: New values of states by name (n x 1), expressions of (t, x, c): x before the event, switches
            in c after it.
        impact: Whether velocities jump by a plastic impact, so that no rigid connection that is active
            afterwards slips.
        loss: Energy [J] that the event dissipates in addition to the impact, an expression as in ``updates``
            (1x1), or None.
        ends: Whether it ends the rollout.
        kink: Whether it only marks a point where a law is not smooth, so that an integrator may step over it.
        speed: If the guard is minus a gap between two bodies: upper bound (1x1) [m/s] of the gap's rate for
            any position of the nearest points; else None. Integrators then miss no contact between two
            evaluations of the gap.
        clock: Whether its guard is time minus an instant that only events change, as in
            :class:`~spacerobot.elements.core.clock.Clock`: steps then end there without root finding.
        silent: Whether it is not recorded; for a clock that changes no switch.
        routine: Whether it recurs by design, such as pulses and samples: batches do not record it.
        quantised: Whether its updates, or the instants that they set, are step functions of their arguments.
        onboard: Whether onboard software performs it although an actuator declares it: residual tests and
            pulse decisions.
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
    """Whether all conditions hold: switches or other truth values (1x1 each)."""
    conjunction = ca.SX(1)
    for condition in conditions:
        conjunction = ca.logic_and(conjunction, condition)
    return conjunction


def either(*conditions: ca.SX) -> ca.SX:
    """Whether any condition holds (1x1 each)."""
    disjunction = ca.SX(0)
    for condition in conditions:
        disjunction = ca.logic_or(disjunction, condition)
    return disjunction


def negated(condition: ca.SX) -> ca.SX:
    """Whether a condition does not hold (1x1)."""
    return ca.logic_not(condition)
