"""Ctrl-C that is not lost.

Python raises ``KeyboardInterrupt`` wherever it is; inside an import or a conversion that a library written in
C asks for, that library may take it for a failure of its own and go on.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType


class Remembering:
    """Handler of SIGINT that raises, and remembers that it did."""

    def __init__(self) -> None:
        self.came = False

    def __call__(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 (its signature)
        """Raise as Python's own handler does."""
        self.came = True
        raise KeyboardInterrupt


@contextlib.contextmanager
def remembered() -> Iterator[None]:
    """Remember Ctrl-C while the block runs, for :func:`heed`; only the main thread may ask for it.

    Where something else than Python's own handler is set (a shell has a job in the background ignore Ctrl-C),
    that stays.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, Remembering())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def heed() -> None:
    """Between two pieces of work: stop if Ctrl-C came and was lost.

    Raises
    ------
    KeyboardInterrupt
        If it came.
    """
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, Remembering) and handler.came:
        raise KeyboardInterrupt
