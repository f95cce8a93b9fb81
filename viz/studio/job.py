"""One job of the studio, and how it tells a page how far it is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from viz.studio.messages import Request


@dataclass(frozen=True)
class SearchFound:
    """How far a search is.

    Attributes
    ----------
    progress
        Part of its budget that is spent.
    values, objective
        Best so far, by path, and the metric there.
    start
        The metric of the design that it began with.
    curve
        Rollouts spent and best metric, in turn.
    message
        How it is getting on, or how it ended.
    """

    progress: float
    values: Mapping[str, float]
    objective: float
    start: float
    curve: Sequence[tuple[float, float]]
    message: str = ""

    def plain(self) -> dict[str, Any]:
        """Plain data for the page."""
        best = {"values": dict(self.values), "objective": self.objective} if self.curve else None
        about = {"progress": self.progress, "message": self.message, "start": self.start}
        # at most about 300 points of the curve, the last one included
        curve = [*self.curve[: -1 : max(1, len(self.curve) // 300)], *self.curve[-1:]]
        return {**about, "best": best, "curve": [list(point) for point in curve]}


PAUSE_S = 0.1
"""At least so long between two messages of a job."""

Send = Callable[[Any, dict[str, Any]], None]


@dataclass
class Job:
    """One job: who asked, whether it shall stop, what was told last.

    Attributes
    ----------
    id, page, request
        Its name, who asked for it, and what was asked.
    stop
        Set where it shall end.
    told_at
        When something was told of it.
    ended
        Whether its end has been told: who hears of it may begin another one at once.
    """

    id: str
    page: Any
    request: Request
    send: Send
    stop: threading.Event = field(default_factory=threading.Event)
    told_at: float = 0.0
    ended: bool = False

    def tell(self, state: str = "running", *, always: bool = False, **what: Any) -> None:
        """Tell the page, but not too often."""
        now = time.monotonic()
        if always or state != "running" or now - self.told_at > PAUSE_S:
            self.told_at = now
            self.ended |= state != "running"
            about = {"type": "job", "id": self.id, "kind": self.request.kind, "state": state}
            self.send(self.page, {**about, "metric": self.request.more.get("metric"), **what})

    def found(self, found: SearchFound, state: str = "running", *, always: bool = False) -> None:
        """Tell how far a search is."""
        if always or state != "running" or time.monotonic() - self.told_at > PAUSE_S:
            self.tell(state, always=True, **found.plain())
