"""Data of an event of an interpreted rollout, for the backward sweep."""

from __future__ import annotations

from dataclasses import dataclass

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.tables import Integers


@dataclass(frozen=True)
class InterpretedEvent:
    """An event of an interpreted rollout.

    Attributes
    ----------
    event
        Which.
    time_s
        When.
    before, after
        States.
    steps
        Steps done before it.
    located
        Whether it fired at its guard's root, at the end of a step; else at once, where one begins.
    first
        What the segment behind it begins with, as in :class:`~spacerobot.rollout.segments.StepPlan`.
    c, row
        Constants after it, and the rows of tables before it.
    near
        How many others were so close that they may change places with it.
    """

    event: int
    time_s: float
    before: Array
    after: Array
    steps: int
    located: bool
    first: int
    c: Array
    row: Integers
    near: int = 0
