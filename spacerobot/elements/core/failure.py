"""Failures: events at which a switch turns on and stays on."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
from pydantic import Field

from spacerobot.common.section import MAX_SAMPLES, Section, quantity
from spacerobot.elements.core.contribution import Output
from spacerobot.elements.core.event import Event, negated
from spacerobot.elements.core.section_context import SectionContext


class Failure(Section):
    """Failure at a time."""

    at: float = quantity("s", "time of the failure", ge=0)


class AllocatedFailure(Failure):
    """Failure of one of several that share a command."""

    known: bool = Field(
        default=False, description="whether the allocation leaves it out from then on; it does upon detection"
    )


class ResidualTest(Section):
    """Test of residuals of momentum; see :mod:`spacerobot.elements.actuators.momentum_residual`."""

    period: float = quantity("s", "time between two samples", gt=0, recurs=MAX_SAMPLES)
    bandwidth: float = quantity("1/s", "K, rate of the residual's lag", default=10.0, gt=0)
    spin_noise: float = quantity(
        "rad/s", "standard deviation of a sample of the base's spin", default=0.0, ge=0
    )
    false_alarms: float = quantity("1/h", "F, greatest rate of false alarms", default=0.01, gt=0)


def failing(
    context: SectionContext,
    name: str,
    *,
    switch: str = "failed",
    sets: Mapping[str, bool] | None = None,
    updates: Mapping[str, ca.SX] | None = None,
    impact: bool = False,
) -> tuple[ca.SX, Event]:
    """Switch that the failure of a part turns on, and the event of the failure.

    Args:
        context: Context of the section with the time ``at`` of the failure [s].
        name: Name of the failing part; the event is ``name.failed``.
        switch: Name of the switch, unique in the section.
        sets, updates, impact: Further effects of the event; see
            :class:`~spacerobot.elements.core.event.Event`.
    """
    failed = context.switch(switch)
    switch_values = {failed.name(): True} | dict(sets or {})
    guard = context.time - context.number("at")
    return failed, Event(
        f"{name}.failed",
        "failed",
        name,
        guard,
        negated(failed),
        switch_values,
        dict(updates or {}),
        impact=impact,
        clock=True,
    )


def detection(
    name: str,
    who: str,
    excess: ca.SX,
    switch: ca.SX,
    *,
    sets: Mapping[str, bool] | None = None,
    impact: bool = False,
) -> Event:
    """Event of a detected failure; a switch is on from then on.

    Args:
        name, who: Name of the event, and of the part that has failed.
        excess: Relative excess of the test over its threshold (1x1), above zero for an alarm.
        switch: The switch (1x1).
        sets, impact: Further effects of the event; see :class:`~spacerobot.elements.core.event.Event`.
    """
    switch_values = {switch.name(): True} | dict(sets or {})
    return Event(name, "detected", who, excess, negated(switch), switch_values, impact=impact, onboard=True)


def detected_failures(count: ca.SX, robot: str) -> Output:
    """Output with the number (1x1) of failures that tests of a robot have detected."""
    return Output("failures_detected", count, "1", "failures that were detected", "body", robot)
