"""Keyword arguments that functions of the public namespace share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from spacerobot.common.files import StrPath
from spacerobot.result import JOURNALS
from spacerobot.simulation import Backend

if TYPE_CHECKING:
    from optim.campaign import CampaignProgress
    from optim.search.search import SearchProgress
    from optim.search.session import SearchSession
    from optim.workers import Workers


class PlanOptions(TypedDict, total=False):
    """Keyword arguments of functions that plan.

    Attributes:
        backend: ``auto`` (chosen by the estimated time), ``compiled`` or ``interpreted``.
        progress: Callback with a short text, called when a step that may take long begins.
        dask: Address of the Dask cluster that solves: ``local:N``, ``tcp://HOST:PORT`` or a scheduler file;
            this process if None. Results do not depend on it.
    """

    backend: Backend
    progress: Callable[[str], None] | None
    dask: str | None


class CampaignOptions(TypedDict, total=False):
    """Keyword arguments of campaigns.

    Attributes:
        progress: Callback, called when a phase begins and after every chunk of samples.
        threads: Number of threads; one for each usable core if None. Results do not depend on it.
        dask: Address of the Dask cluster that rolls out, such as ``local:4``; this process if None. Results
            do not depend on it.
    """

    progress: Callable[[CampaignProgress], object] | None
    threads: int | None
    dask: str | None


class SearchOptions(TypedDict, total=False):
    """Keyword arguments of functions that run many searches.

    Attributes:
        workers: Workers that roll out, from :func:`spacerobot.open_workers`; threads of this process if None.
            Results do not depend on it.
        progress: Callback with the progress of each search.
        notify: Callback with a short text, called when a step that may take long begins.
    """

    workers: Workers | None
    progress: Callable[[SearchProgress], object] | None
    notify: Callable[[str], None] | None


def journals(folder: StrPath | None) -> Path | None:
    """Folder of the journals inside an output folder; an interrupted call continues from them."""
    return None if folder is None else Path(folder) / JOURNALS


def search_session(folder: StrPath | None, options: SearchOptions) -> SearchSession:
    """Journals, workers and callbacks of searches.

    Args:
        folder: Output folder, which contains the journals; no journals if None.
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
