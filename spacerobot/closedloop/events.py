"""Events of the closed loop: guards and updates of all elements combined into one function each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.impulse import PlasticImpact, strike
from spacerobot.elements import Contribution, Event, PowerTerm
from spacerobot.symbolic import Plant

WORK = "event"
"""Name of the work to which energy losses at events are booked."""


@dataclass(frozen=True)
class LoopEvent:
    """Properties of an event for integrators.

    Attributes:
        name, kind, who: See :class:`~spacerobot.elements.Event`.
        sets: Indices among the loop's switches, and the value of each after the event.
        ends: Whether it ends the rollout.
        kink: Whether it only marks a point where the dynamics are not smooth.
        gap: Whether its guard is minus a gap whose rate is bounded.
        clock, silent: Whether its guard is time minus an instant that only events change; whether it is not
            recorded.
        routine: Whether batches do not record it.
        quantised: Whether its updated values are quantised.
    """

    name: str
    kind: str
    who: str
    sets: tuple[tuple[int, bool], ...]
    ends: bool
    kink: bool = False
    gap: bool = False
    clock: bool = False
    silent: bool = False
    routine: bool = False
    quantised: bool = False


def booked(events: Sequence[Event]) -> tuple[PowerTerm, ...]:
    """Work of events as a power term, constant between events; empty if no event dissipates energy."""
    loses_energy = any(event.impact or event.loss is not None for event in events)
    return (PowerTerm(WORK, ca.SX(1, 1)),) if loses_energy else ()


def rules_of(events: Sequence[Event], switches: Sequence[str]) -> tuple[LoopEvent, ...]:
    """Events as data, for switches of these names."""
    places = {name: i for i, name in enumerate(switches)}
    return tuple(
        LoopEvent(
            event.name,
            event.kind,
            event.who,
            tuple((places[name], value) for name, value in event.sets.items()),
            event.ends,
            event.kink,
            event.speed is not None,
            event.clock,
            event.silent,
            event.routine,
            event.quantised,
        )
        for event in events
    )


def guards_of(events: Sequence[Event], time: ca.SX, x: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Guards and their rates along x' (ne x 1 each); minus infinity and zero where not armed."""
    none = ca.SX(0, 1)
    values = ca.vertcat(none, *(event.guard for event in events))
    rates = ca.jtimes(values, ca.vertcat(time, x), ca.vertcat(1, rate)) if events else none
    armed = ca.vertcat(none, *(event.armed for event in events))
    return ca.if_else(armed, values, -ca.inf), ca.if_else(armed, rates, 0)


def speeds_of(events: Sequence[Event]) -> ca.SX:
    """Upper bounds of the rates of gaps (n x 1) [m/s], of the events that have one in turn."""
    return ca.vertcat(ca.SX(0, 1), *(event.speed for event in events if event.speed is not None))


def update_of(plant: Plant, acting: Contribution, which: ca.SX, impact: PlasticImpact | None = None) -> ca.SX:
    """State after event number ``which`` (1x1), from that before it (nx x 1).

    An impact is that of articulated bodies unless another one is given.
    """
    if impact is None and any(event.impact for event in acting.events):
        impact = strike(plant, acting.constraints)
    symbols = {state.name: state.symbol for state in acting.states}
    velocity, values = plant.v, dict(symbols)
    for number, event in enumerate(acting.events):
        happens = which == number
        if event.impact and impact is not None:
            velocity = ca.if_else(happens, impact.velocity, velocity)
        for name, value in _new_values(event, acting, impact, symbols):
            values[name] = ca.if_else(happens, value, values[name])
    return ca.vertcat(plant.q, velocity, *values.values())


def _new_values(
    event: Event, acting: Contribution, impact: PlasticImpact | None, symbols: Mapping[str, ca.SX]
) -> Iterator[tuple[str, ca.SX]]:
    """New values of states by name: the event's own updates, effects of impulses, and work."""
    yield from event.updates.items()
    energy_loss = ca.SX(1, 1) if event.loss is None else event.loss
    if event.impact and impact is not None:
        energy_loss = energy_loss + impact.loss
        for constraint, impulse in zip(acting.constraints, impact.impulses, strict=True):
            if constraint.struck is not None:
                yield from constraint.struck(*constraint.on_target(impulse)).items()
    if event.impact or event.loss is not None:
        yield f"work.{WORK}", symbols[f"work.{WORK}"] + energy_loss
