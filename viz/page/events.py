"""Phases and events of a result, for the page's timeline."""

from __future__ import annotations

from typing import Any

from spacerobot.result import Result
from spacerobot.result.events import what_happened
from viz.figures.phases import phases_of


def event_data(result: Result) -> dict[str, Any]:
    """Phases as (name, start, end) and all other events as (time, text, kind), times in s.

    The closest approach of a missed grasp is marked as well, with the reason.
    """
    events = result.summary.get("events", ())
    marks = [
        [event["time_s"], what_happened(event), event["kind"]]
        for event in events
        if event["kind"] not in ("phase", "end")
    ]
    missed = result.summary.get("missed", {})
    marks += [
        [why["closest"]["time_s"], f"{grasp} missed: {why['words']}", "slipped"]
        for grasp, why in missed.items()
        if "closest" in why
    ]
    return {"phases": [list(phase) for phase in phases_of(result)], "marks": sorted(marks)}
