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
        folder: Where journals are kept, so that killed searches go on where they were; nowhere if None.
        workers: Who rolls out. Only times depend on it.
        progress, tell: Told how a search is getting on, and what begins.
    """

    folder: StrPath | None = None
    workers: Workers = field(default_factory=Threads)
    progress: Progress | None = None
    tell: Tell = field(default=lambda _: None)

    @property
    def place(self) -> Path | None:
        """Folder of the journals, as a path."""
        return None if self.folder is None else Path(self.folder)
