"""Progress of compilations, reported to listeners such as the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Listener = Callable[[int, int], None]
"""Callback with the number of compiled sources and the number of all sources."""

_listeners: list[Listener] = []  # of the process, since any thread may compile


@contextmanager
def hearing(listener: Listener) -> Iterator[None]:
    """Report the compilations of this process to a listener during the block."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def tell(done: int, total: int) -> None:
    """Report progress to all listeners."""
    for listener in tuple(_listeners):
        listener(done, total)
