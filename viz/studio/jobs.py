"""Background jobs of the studio: searches, campaigns and stability margins; they can be stopped."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Mapping
from typing import Any

from spacerobot.common.errors import SpaceRobotError
from viz.studio.campaign import cloud
from viz.studio.job import Job, Send
from viz.studio.margins import loop_margins_job
from viz.studio.messages import Request
from viz.studio.prepared_design import DesignCache
from viz.studio.search import improve, tune


class Jobs:
    """Jobs of a session, one at a time.

    Args:
        plants: Prepared structures of designs.
        send: Function that sends a message to a page.
        more: Functions of further kinds of jobs, in addition to ``DO``.
    """

    def __init__(
        self, plants: DesignCache, send: Send, more: Mapping[str, Callable[..., None]] | None = None
    ) -> None:
        self.plants, self._send, self._do = plants, send, {**DO, **(more or {})}
        self._names = map(str, itertools.count(1))
        self._job: Job | None = None

    def begin(self, page: Any, request: Request) -> None:
        """Begin a job.

        Raises:
            SpaceRobotError: If another one is running.
        """
        if self._job is not None and not self._job.ended:
            raise SpaceRobotError("another job is running; stop it first")
        self._job = Job(next(self._names), page, request, self._send)
        threading.Thread(target=self._run, args=(self._job,), name="studio job", daemon=True).start()

    def stop(self, name: str) -> None:
        """Stop a job; nothing happens if it has ended."""
        if self._job is not None and self._job.id == name:
            self._job.stop.set()

    def stop_all(self, page: Any = None) -> None:
        """Stop the jobs of a page, or all jobs if None."""
        if self._job is not None and page in (None, self._job.page):
            self._job.stop.set()

    def _run(self, job: Job) -> None:
        job.tell(always=True, progress=0.0, message="building the closed loop")
        try:
            design = self.plants.find(job.request.values)
            if design is None:
                self.plants.make(job.request.values)
                design = self.plants.find(job.request.values)
            assert design is not None
            self._do[job.request.kind](self.plants, *design, job)
            self._send(None, {"type": "compiling", "why": ""})
        except Exception as fault:  # a defect is told as well, instead of a job that never ends
            self._send(None, {"type": "compiling", "why": ""})
            job.tell("failed", progress=1.0, message=str(fault) or type(fault).__name__)
        finally:
            job.ended = True


DO: Mapping[str, Callable[..., None]] = {
    "improve": improve,
    "tune": tune,
    "campaign": cloud,
    "margins": loop_margins_job,
}
"""Function of each kind of job."""
