"""Background job of the studio, with progress messages to its page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from viz.studio.messages import Request

PAUSE_S = 0.1
"""Minimum time between two messages of a job [s]."""

Send = Callable[[Any, dict[str, Any]], None]


class StoppedError(Exception):
    """Error that ends a job which the page has cancelled."""


@dataclass
class Job:
    """Job: requesting page, stop flag, last message.

    Attributes:
        id, page, request: Id, requesting page, and request.
        stop: Event that is set to stop it.
        told_at: Time of the last message.
        ended: Whether its end has been reported; a page may start the next job after that report.
    """

    id: str
    page: Any
    request: Request
    send: Send
    stop: threading.Event = field(default_factory=threading.Event)
    told_at: float = 0.0
    ended: bool = False

    @property
    def is_due(self) -> bool:
        """Whether enough time has passed since the last message."""
        return time.monotonic() - self.told_at > PAUSE_S

    def tell(self, state: str = "running", *, always: bool = False, **what: Any) -> None:
        """Send a message to the page, at a limited rate."""
        if always or state != "running" or self.is_due:
            self.told_at = time.monotonic()
            self.ended |= state != "running"
            about = {"type": "job", "id": self.id, "kind": self.request.kind, "state": state}
            self.send(self.page, {**about, "metric": self.request.more.get("metric"), **what})
