"""Saturation of actuators: limits at which the delivered force has a kink, as events at which steps end."""

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
    """Events at which commands of parts of an actuator cross their limits.

    What is delivered has kinks there and depends on no switch: steps end there, so that the method keeps its
    order, and derivatives by a limit know when it begins and ends to count.

    Args:
        actuator: The actuator.
        names: Labels of the parts.
        beyond: Relative excess of each command over its limit, above zero where it is clipped (n x 1).
        free: Switches (1x1 each) without which a part takes no part; none if all always do.
        side: Label of the limit, where parts have several.
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
