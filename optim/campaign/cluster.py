"""Many machines: chunks of a campaign on Dask's workers.

Dask is optional and imported only here, when it is used. A chunk is a recipe and the draws of its samples; a
worker builds the recipe once and keeps it, its machine compiles it once and keeps that. The process that
asked is the only one that writes. So a worker that dies loses its chunk, which another one then does, and
nothing else.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optim.campaign.evaluator import Evaluator, Recipe, Table
from optim.campaign.run import CHUNK_S, Chunks, first_size, sized
from optim.protocol import Array
from spacerobot.compiled.cache import cache_folder
from spacerobot.errors import SpaceRobotError

AHEAD = 2  # chunks in flight for each thread of a worker: one runs, one waits
ATTEMPTS = 3  # workers that a chunk may cost before the campaign gives up
KEPT = 4  # evaluators that a worker keeps

_built: dict[str, Evaluator] = {}
_lock = threading.Lock()


@dataclass(frozen=True)
class Dask:
    """Dask's workers.

    Attributes
    ----------
    address
        ``local:N`` (so many processes of this machine), ``tcp://host:port`` (or another address that Dask
        knows), or a scheduler file.
    chunk_s
        How long a chunk shall take.
    size
        Samples of a chunk, if it shall not be sized to seconds.
    """

    address: str
    chunk_s: float = CHUNK_S
    size: int | None = None

    def work(self, evaluator: Evaluator, draws: Array, chunks: Chunks) -> Iterator[tuple[int, Table]]:
        """Every chunk as it comes; see :class:`optim.campaign.Executor`.

        Raises
        ------
        SpaceRobotError
            If Dask is not installed, cannot be reached, or a chunk fails on one worker after the other.
        """
        with connect(self.address) as client:
            first = self.size or first_size(evaluator)
            yield from _spread(client, evaluator.recipe, draws, chunks, self, first)


@contextlib.contextmanager
def connect(address: str) -> Iterator[Any]:
    """Client of a cluster; one of this machine ends with it.

    Raises
    ------
    SpaceRobotError
        If Dask is not installed, the address is none, or nobody answers there.
    """
    distributed = _distributed()
    if address.startswith("local:"):
        count = address.removeprefix("local:")
        if not count.isdecimal() or int(count) < 1:
            raise SpaceRobotError(f"found {address!r}, allowed: local:N with N of 1 and more", where="--dask")
        options: dict[str, Any] = {"n_workers": int(count), "threads_per_worker": 1}
        with (
            distributed.LocalCluster(**options, host="127.0.0.1", dashboard_address=None) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
        return
    place = {"address": address} if "://" in address else {"scheduler_file": _scheduler_file(address)}
    try:
        client = distributed.Client(**place, timeout="20s")
    except (OSError, TimeoutError, ValueError) as fault:
        raise SpaceRobotError(f"no scheduler answers at {address}: {fault}", where="--dask") from None
    with client:
        yield client


def run_chunk(recipe: Recipe, draws: Array) -> tuple[Table, float]:
    """Work of one chunk, on a worker: its table, and the seconds that its rollouts took.

    One thread: the worker runs as many chunks at once as it was given threads.
    """
    import time

    evaluator = _evaluator(recipe)
    since = time.perf_counter()
    table = evaluator.evaluate(draws, threads=1)
    return table, time.perf_counter() - since


def _evaluator(recipe: Recipe) -> Evaluator:
    """The evaluator of a recipe, built once in this process."""
    key = recipe.key
    with _lock:
        if key not in _built:
            while len(_built) >= KEPT:
                _built.pop(next(iter(_built)))
            with _alone_on_this_machine():
                _built[key] = recipe.build()
        return _built[key]


@contextlib.contextmanager
def _alone_on_this_machine() -> Iterator[None]:
    """Let one worker of a machine compile while the others wait, to find it compiled."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (cache_folder() / "campaign.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _spread(
    client: Any, recipe: Recipe, draws: Array, chunks: Chunks, how: Dask, first: int
) -> Iterator[tuple[int, Table]]:
    """Keep every worker busy, with few chunks in flight, and give out results as they come."""
    distributed = _distributed()
    client.wait_for_workers(1, timeout=60)
    size = first
    flight = distributed.as_completed([], with_results=False)
    pieces: dict[str, tuple[int, int]] = {}

    def fill(size: int) -> None:
        threads = max(1, sum(client.nthreads().values()))
        while len(pieces) < AHEAD * threads and (piece := chunks.take(size)) is not None:
            future = client.submit(
                run_chunk, recipe, draws[piece[0] : piece[1]], pure=False, retries=ATTEMPTS
            )
            pieces[future.key] = piece
            flight.add(future)

    fill(size)
    for future in flight:
        begin, end = pieces.pop(future.key)
        try:
            table, seconds = future.result()
        except distributed.KilledWorker:
            message = f"samples {begin} to {end - 1} ended {ATTEMPTS + 1} workers; what is there is kept"
            raise SpaceRobotError(message, where="--dask") from None
        yield begin, table
        size = how.size or sized(len(table), seconds, how.chunk_s)
        fill(size)


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        message = "needs Dask: pip install 'dask[distributed]'"
        raise SpaceRobotError(message, where="--dask") from None


def _scheduler_file(name: str) -> str:
    path = Path(name)
    try:
        json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        message = f"found {name!r}, allowed: local:N, tcp://HOST:PORT, or a scheduler file"
        raise SpaceRobotError(message, where="--dask") from None
    return str(path)
