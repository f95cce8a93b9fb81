"""Progress of compilations, whatever began them: reported to the command line, or to any other listener."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Listener = Callable[[int, int], None]
"""Called with the pieces that are compiled, and how many there are."""

_listeners: list[Listener] = []  # of the process: what a command begins may compile in any thread


@contextmanager
def hearing(listener: Listener) -> Iterator[None]:
    """Tell a listener of whatever this process compiles."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def tell(done: int, total: int) -> None:
    """Tell all listeners."""
    for listener in tuple(_listeners):
        listener(done, total)
