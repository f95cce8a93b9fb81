"""CasADi's messages: its warnings are written to Python's standard error by the computing thread."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from typing import Any

INTERRUPT = "KeyboardInterrupt"
"""Part of CasADi's warning after Ctrl-C; CasADi then raises an exception of another type."""


class CasadiMessages:
    """Standard error that collects the output of one thread and passes on that of other threads.

    Args:
        stream: Standard error.
    """

    def __init__(self, stream: Any) -> None:
        self.text, self._stream, self._thread = "", stream, threading.get_ident()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Collect this thread's text; write other threads' text, such as a spinner's."""
        if threading.get_ident() != self._thread:
            return int(self._stream.write(text))
        self.text += text
        return len(text)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C was pressed while CasADi computed."""
        return INTERRUPT in self.text


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Context that hides CasADi's messages if Ctrl-C was pressed; otherwise they are written when it ends.

    Only the main thread receives Ctrl-C; in other threads no message is hidden.
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
