"""Failures: an event at which a switch turns, and stays so."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from spacerobot.elements.event import Event, negated
from spacerobot.elements.section_context import SectionContext
from spacerobot.section import Section, quantity


class Failure(Section):
    """Failure at a time."""

    at: float = quantity("s", "time of the failure", ge=0)


def failing(
    context: SectionContext,
    name: str,
    *,
    switch: str = "failed",
    sets: Mapping[str, bool] | None = None,
    updates: Mapping[str, ca.SX] | None = None,
    impact: bool = False,
) -> tuple[ca.SX, Event]:
    """Switch that the failure of a part turns on, and the event that does so.

    Parameters
    ----------
    context
        Of the section with the time ``at`` of the failure [s].
    name
        What fails; the event is ``name.failed``.
    switch
        Name of the switch, unique in the section.
    sets, updates, impact
        What else the event does; see :class:`~spacerobot.elements.event.Event`.
    """
    failed = context.switch(switch)
    turned = {failed.name(): True} | dict(sets or {})
    guard = context.time - context.number("at")
    return failed, Event(
        f"{name}.failed",
        "failed",
        name,
        guard,
        negated(failed),
        turned,
        dict(updates or {}),
        impact=impact,
        clock=True,
    )
