"""Keyword arguments that functions of the public namespace share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from spacerobot.common.files import StrPath
from spacerobot.result import JOURNALS
from spacerobot.simulation import Backend

if TYPE_CHECKING:
    from optim.search.search import SearchProgress
    from optim.search.session import SearchSession
    from optim.workers import Workers


class PlanOptions(TypedDict, total=False):
    """Keyword arguments of functions that plan.

    Attributes:
        backend: ``auto`` (compiled where that pays), ``compiled`` or ``interpreted``.
        progress: Called with a few words whenever a step that may take a while begins.
        dask: Address of a Dask cluster that solves: ``local:N``, ``tcp://HOST:PORT`` or a scheduler file;
            this process if None. Results do not depend on it.
    """

    backend: Backend
    progress: Callable[[str], None] | None
    dask: str | None


class SearchOptions(TypedDict, total=False):
    """Keyword arguments of functions that run many searches.

    Attributes:
        workers: Workers that roll out, from :func:`spacerobot.open_workers`; threads of this process if None.
            Results do not depend on it.
        progress: Called with the progress of each search.
        notify: Called with a few words whenever a step that may take a while begins.
    """

    workers: Workers | None
    progress: Callable[[SearchProgress], object] | None
    notify: Callable[[str], None] | None


def journals(folder: StrPath | None) -> Path | None:
    """Folder inside an output folder that keeps what an interrupted call continues from."""
    return None if folder is None else Path(folder) / JOURNALS


def search_session(folder: StrPath | None, options: SearchOptions) -> SearchSession:
    """Journals, workers and callbacks of searches.

    Args:
        folder: Output folder, in which journals are kept; none are if None.
        options: Keyword arguments of the call.
    """
    from optim.search.session import SearchSession
    from optim.workers import Threads

    return SearchSession(
        journals(folder),
        options.get("workers") or Threads(),
        options.get("progress"),
        options.get("notify") or (lambda _: None),
    )
