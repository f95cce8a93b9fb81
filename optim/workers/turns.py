"""Searches that wait for others' work side by side, while only one of them computes at a time.

A search spends its time waiting for rollouts. What it does between them (a library's own steps) need not be
safe beside another's: the baton passes only where a search waits. NumPy's global random state, which CMA-ES
draws from, goes with the search it belongs to, so that no search depends on the others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import numpy as np

from optim.workers.protocol import Ended

TICK_S = 0.2  # how often the waiting thread looks for Ctrl-C


class Turns:
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

        Raises
        ------
        KeyboardInterrupt
            If everything shall stop.
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

        Raises
        ------
        Exception
            The first that a search raised; the others are stopped then.
        """
        self._stop.clear()
        ended: dict[int, Ended] = {}
        faults: dict[int, BaseException] = {}

        def work(index: int) -> None:
            with self._baton:
                self._mine.turn = True
                if self.stopped:
                    return
                try:
                    ended[index] = searches[index]()
                except BaseException as fault:
                    faults[index] = fault
                    self._stop.set()

        threads = [threading.Thread(target=work, args=(i,), daemon=True) for i in range(len(searches))]
        try:
            for thread in threads:
                thread.start()
            _join(threads)
        except KeyboardInterrupt:
            self._stop.set()
            _join(threads)
        for index in sorted(faults):
            with suppress(KeyboardInterrupt):
                raise faults[index]
        if self.stopped and not ended:
            raise KeyboardInterrupt
        return [ended[index] for index in sorted(ended)]


def _join(threads: Sequence[threading.Thread]) -> None:
    for thread in threads:
        while thread.is_alive():
            thread.join(TICK_S)
