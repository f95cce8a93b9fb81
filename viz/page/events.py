"""Phases and events of a result, for the page's timeline."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from spacerobot.result import Result
from spacerobot.result.events import what_happened


def event_data(result: Result) -> dict[str, Any]:
    """Phases as (name, begin, end) and all other events as (time, what, kind), times in s."""
    events, end = result.summary.get("events", ()), float(result.data.time.values[-1])
    begun = [(name, 0.0) for name in list(result.scenario.phases)[:1]]
    begun += [(event["who"], event["time_s"]) for event in events if event["kind"] == "phase"]
    return {
        "phases": [[name, begin, until] for (name, begin), (_, until) in pairwise([*begun, ("", end)])],
        "marks": [
            [event["time_s"], what_happened(event), event["kind"]]
            for event in events
            if event["kind"] not in ("phase", "end")
        ],
    }
