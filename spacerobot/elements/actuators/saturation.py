"""Saturation of actuators: events at the limits, where the delivered force has a kink and steps must end."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.event import Event, both, negated


def saturation_events(
    actuator: ActuatorContext,
    names: Sequence[str],
    beyond: ca.SX,
    *,
    free: Sequence[ca.SX] = (),
    side: str = "",
) -> tuple[Event, ...]:
    """Events at which commands of an actuator's parts cross their limits.

    The delivered force has kinks there and depends on no switch. Steps end at the events, so that the method
    keeps its order and derivatives with respect to a limit include the interval in which it is active.

    Args:
        actuator: The actuator.
        names: Labels of the parts.
        beyond: Relative excess of each command over its limit, above zero where it is clipped (n x 1).
        free: Switch of each part (1x1 each) that must be on for its events to fire; empty if all parts are
            always active.
        side: Label of the limit, if parts have several.
    """
    events = list[Event]()
    for i, name in enumerate(names):
        clipped = actuator.context.switch(f"clipped{side}.{i}")
        acts = free[i] if free else ca.SX(1)
        for kind, guard, armed, on in (
            ("clipped", beyond[i], negated(clipped), True),
            ("unclipped", -beyond[i], clipped, False),
        ):
            sets = {clipped.name(): on}
            label = f"{name}.{kind}{side}"
            events.append(Event(label, kind, name, guard, both(armed, acts), sets, kink=True))
    return tuple(events)
