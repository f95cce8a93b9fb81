"""Journals, workers and callbacks of searches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from optim.search.search import Progress
from optim.workers import Threads, Workers
from spacerobot.common.files import StrPath

Tell = Callable[[str], None]


@dataclass(frozen=True)
class SearchSession:
    """Workers of searches, folder of their journals and callback of their progress.

    Attributes:
        folder: Folder of the journals, from which interrupted searches resume; None writes no journal.
        workers: Threads or processes that roll out. Results do not depend on their number.
        progress: Callback that receives the :class:`~optim.search.search.SearchProgress` of a search.
        tell: Callback that receives a line of text when a step begins.
    """

    folder: StrPath | None = None
    workers: Workers = field(default_factory=Threads)
    progress: Progress | None = None
    tell: Tell = field(default=lambda _: None)

    @property
    def place(self) -> Path | None:
        """Folder of the journals, as a path."""
        return None if self.folder is None else Path(self.folder)
