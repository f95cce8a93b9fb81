"""CasADi's messages: its warnings reach Python's standard error from the thread that computes."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from typing import Any

INTERRUPT = "KeyboardInterrupt"
"""Part of CasADi's warning after Ctrl-C, which it raises as an exception of its own."""


class CasadiMessages:
    """Standard error that collects what one thread writes, and writes what others do.

    Args:
        stream: Standard error.
    """

    def __init__(self, stream: Any) -> None:
        self.text, self._stream, self._thread = "", stream, threading.get_ident()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Collect what this thread writes; write what another does, as a spinner's."""
        if threading.get_ident() != self._thread:
            return int(self._stream.write(text))
        self.text += text
        return len(text)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C came while CasADi computed."""
        return INTERRUPT in self.text


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Leave out the warning that CasADi prints after Ctrl-C; other messages follow at the end.

    Only the main thread is interrupted: elsewhere nothing is left out.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    messages = CasadiMessages(sys.stderr)
    try:
        with contextlib.redirect_stderr(messages):
            yield
    finally:
        if messages.text and not messages.interrupted:
            sys.stderr.write(messages.text)
