"""Dask's workers for searches: they evaluate values and derivatives; searches and journals stay here.

The calling process runs all searches and alone writes files. If a worker dies, only its current rows are
lost, and another worker evaluates them.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from optim.workers.cluster import (
    alone_on_this_machine,
    connect,
    distributed_module,
    faults_of,
    submit,
    threads_of,
)
from optim.workers.concurrent_searches import TurnLock
from optim.workers.threads import Threads, joined
from optim.workers.workers import LANES, Arrays, Ended, Operation, Portable, Workers
from spacerobot.common.arrays import Array

SHORTEST_S = 0.25  # that a piece shall take at least, to hide what sending it costs
LONGEST_S = 4.0  # that it shall take at most, to lose little with a worker
TICK_S = 0.2  # how often a search that waits looks whether it shall stop

_warm: set[tuple[str, str]] = set()


class DaskWorkers:
    """Workers of a cluster; see :class:`optim.workers.Workers`.

    Args:
        client: Client from :func:`optim.workers.cluster.connect`.
        threads: Threads that this process itself may use; each usable core if None.
    """

    def __init__(self, client: Any, threads: int | None = None) -> None:
        self.threads = threads
        self._client, self._turns = client, TurnLock()
        self._row_s: dict[tuple[str, str], float] = {}

    def map(self, problem: Portable, operation: Operation, rows: Array, *, grain: int = LANES) -> Arrays:
        """Pieces sized to seconds, learnt from earlier ones; see :class:`optim.workers.Workers`.

        Raises:
            SpaceRobotError: If a piece ended one worker after the other.
        """
        recipe = problem.recipe
        learnt = (recipe.key, _name(operation))
        # one piece for each thread, fewer if they were too short, more if they were too long
        threads, most, row_s = threads_of(self._client), max(1, len(rows) // grain), self._row_s.get(learnt)
        count = min(threads, most)
        if row_s is not None:
            longest = int(np.ceil(len(rows) * row_s / LONGEST_S))
            count = min(max(1, min(threads, int(len(rows) * row_s / SHORTEST_S)), longest), most)
        futures = [
            submit(self._client, run_piece, recipe, operation, part) for part in np.array_split(rows, count)
        ]
        with self._turns.away():
            pieces = self._gather(futures)
        self._row_s[learnt] = sum(seconds for _, seconds in pieces) / len(rows)
        return joined([arrays for arrays, _ in pieces])

    def together(self, searches: Sequence[Callable[[], Ended]]) -> list[Ended]:
        """Run searches concurrently: one computes here while the others wait for workers."""
        return self._turns.together(searches)

    def _gather(self, futures: Sequence[Any]) -> list[tuple[Arrays, float]]:
        """Results of futures, in order; futures that are no longer needed are cancelled."""
        try:
            while not self._turns.stopped:
                # without a client given, `wait` asks the newest one of this process, which may be another one
                with suppress(TimeoutError), faults_of("an evaluation"), self._client.as_current():
                    distributed_module().wait(futures, timeout=TICK_S)
                    return [future.result() for future in futures]
            raise KeyboardInterrupt
        except BaseException:
            with suppress(Exception):
                self._client.cancel(futures)
            raise


def run_piece(problem: Any, operation: Operation, rows: Array) -> tuple[Arrays, float]:
    """Results of an operation on the rows of one piece, and its duration [s]; runs on a worker.

    On its first call in a process it evaluates a single row beforehand, which compiles the code, one process
    of the machine at a time.
    """
    piece_key = (problem.recipe.key, _name(operation))
    if piece_key not in _warm:
        with alone_on_this_machine():
            operation(problem, rows[:1])
        _warm.add(piece_key)
    since = time.perf_counter()
    arrays = operation(problem, rows)
    return arrays, time.perf_counter() - since


@contextmanager
def open_workers(threads: int | None = None, dask: str | None = None) -> Iterator[Workers]:
    """Threads of this process, or the workers of a cluster while the context lasts.

    Args:
        threads: Threads that this process itself may use; each usable core if None.
        dask: Address of a cluster as for :func:`optim.workers.cluster.connect`; none if None.

    Raises:
        SpaceRobotError: If the cluster cannot be reached.
    """
    if dask is None:
        yield Threads(threads)
        return
    with connect(dask) as client:
        yield DaskWorkers(client, threads)


def _name(operation: Operation) -> str:
    inner = operation.func if isinstance(operation, functools.partial) else operation
    return str(getattr(inner, "__qualname__", inner))
