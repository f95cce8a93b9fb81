"""Concurrent searches, of which only one computes while the others wait for rollouts.

A search mostly waits for rollouts. Its steps in between, such as those of a library, need not be thread-safe,
because another search computes only while this one waits. NumPy's global random state, from which CMA-ES
draws, is saved and restored with each search, so that no search depends on the others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress

import numpy as np

from optim.workers.workers import Ended

TICK_S = 0.2  # how often the waiting thread looks for Ctrl-C


class TurnLock:
    """Lock that the computing search holds, with a flag that stops all searches."""

    def __init__(self) -> None:
        self._baton = threading.Lock()
        self._mine = threading.local()
        self._stop = threading.Event()

    @property
    def stopped(self) -> bool:
        """Whether all searches are to stop."""
        return self._stop.is_set()

    @contextmanager
    def away(self) -> Iterator[None]:
        """Context in which this search waits and another one computes.

        It has no effect outside :meth:`together`.

        Raises:
            KeyboardInterrupt: If all searches are to stop.
        """
        if not getattr(self._mine, "turn", False):
            yield
            return
        state = np.random.get_state()  # noqa: NPY002 (the library's own generator is what must be kept)
        self._baton.release()
        try:
            yield
        finally:
            self._baton.acquire()
            np.random.set_state(state)  # noqa: NPY002
        if self.stopped:
            raise KeyboardInterrupt

    def together(self, searches: Sequence[Callable[[], Ended]]) -> list[Ended]:
        """Run searches concurrently; see :meth:`.Workers.together`.

        Raises:
            Exception: The first exception of a search; the other searches are then stopped.
        """
        self._stop.clear()
        with ThreadPoolExecutor(max(1, len(searches))) as pool:
            futures: list[Future[Ended | None]] = []
            try:
                futures.extend(pool.submit(self._take_turns, search) for search in searches)
                _wait(futures)
            except KeyboardInterrupt:
                self._stop.set()
                _wait(futures)
        ended: list[Ended] = []
        for future in futures:
            with suppress(KeyboardInterrupt):
                end = future.result()
                ended += [] if end is None else [end]
        if self.stopped and not ended:
            raise KeyboardInterrupt
        return ended

    def _take_turns(self, search: Callable[[], Ended]) -> Ended | None:
        """Run a search when it first gets the lock; None if all searches were stopped before."""
        with self._baton:
            self._mine.turn = True
            try:
                return None if self.stopped else search()
            except BaseException:
                self._stop.set()
                raise
            finally:
                self._mine.turn = False


def _wait(futures: Sequence[Future[Ended | None]]) -> None:
    """Wait for futures in short intervals, between which Ctrl-C is handled."""
    while wait(futures, timeout=TICK_S).not_done:
        pass
