"""Concurrent searches, of which only one computes while the others wait for rollouts.

A search spends its time waiting for rollouts. What it does between them (a library's own steps) need not be
thread-safe: another search runs only while one waits. NumPy's global random state, which CMA-ES
draws from, goes with the search it belongs to, so that no search depends on the others.
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
    """A baton, and whether everything shall stop."""

    def __init__(self) -> None:
        self._baton = threading.Lock()
        self._mine = threading.local()
        self._stop = threading.Event()

    @property
    def stopped(self) -> bool:
        """Whether everything shall stop."""
        return self._stop.is_set()

    @contextmanager
    def away(self) -> Iterator[None]:
        """Let other searches compute while this one waits; nothing happens outside of :meth:`together`.

        Raises:
            KeyboardInterrupt: If everything shall stop.
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
        """Do searches side by side and give how they ended, in order; see ``Workers.together``.

        Raises:
            Exception: The first that a search raised; the others are stopped then.
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
    """Wait for futures with timeouts, so that Ctrl-C is handled; ``Thread.join`` takes it for the end."""
    while wait(futures, timeout=TICK_S).not_done:
        pass
