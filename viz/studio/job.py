"""One job of the studio, and how it tells a page how far it is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from viz.studio.messages import Request

PAUSE_S = 0.1
"""At least so long between two messages of a job."""

Send = Callable[[Any, dict[str, Any]], None]


class StoppedError(Exception):
    """The page wants no more of a job."""


@dataclass
class Job:
    """One job: who asked, whether it shall stop, what was told last.

    Attributes:
        id, page, request: Its name, who asked for it, and what was asked.
        stop: Set where it shall end.
        told_at: When something was told of it.
        ended: Whether its end has been told: who hears of it may begin another one at once.
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
        """Whether the last message is long enough ago for another one."""
        return time.monotonic() - self.told_at > PAUSE_S

    def tell(self, state: str = "running", *, always: bool = False, **what: Any) -> None:
        """Tell the page, but not too often."""
        if always or state != "running" or self.is_due:
            self.told_at = time.monotonic()
            self.ended |= state != "running"
            about = {"type": "job", "id": self.id, "kind": self.request.kind, "state": state}
            self.send(self.page, {**about, "metric": self.request.more.get("metric"), **what})
