"""Ctrl-C, everywhere: a command ends with one line and exit code 130, whatever it is doing.

Python raises ``KeyboardInterrupt`` in the main thread, wherever that is. Inside an import or a callback, a
library written in C++ may take it for a failure of its own and go on, and while such a library computes,
nothing is raised at all. So a thread watches as well: it ends the process where the main thread has not ended
a second later. Files are written beside their place and moved there, so that this leaves none half-written.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
SHOW_CURSOR = "\r\x1b[2K\x1b[?25h"
"""For a terminal in which a spinner has hidden it."""
GRACE_S = 1.0
"""Time for the main thread to end by itself."""

_advice = ""
_writing = threading.RLock()
"""Held while :func:`uninterrupted` is: the process does not end in between."""


class _Guard:
    """Handler of SIGINT that raises and remembers, and the thread that watches it."""

    def __init__(self) -> None:
        self.kept = False  # what was found so far is to be kept: the next Ctrl-C stops the search alone
        self.given = False  # and that has come
        self.came = False  # one that ends the command
        self._signals = self._seen = 0
        self._over = threading.Event()
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)

    def __call__(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 (its signature)
        """Raise as Python's own handler does."""
        self._seen += 1
        if self.kept and not self.given:
            self.given = True
        else:
            self.came = True
        raise KeyboardInterrupt

    def begin(self) -> None:
        """Handle SIGINT, and watch: signals are told to a pipe even while the main thread is in a library."""
        signal.signal(signal.SIGINT, self)
        with contextlib.suppress(ValueError):  # no pipe will do where only sockets can be told
            signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name="interrupts", daemon=True).start()

    def end(self) -> None:
        """Leave everything as it was."""
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with contextlib.suppress(ValueError):
            signal.set_wakeup_fd(-1)
        self._over.set()
        os.close(self._write)  # the thread reads its end

    def _watch(self) -> None:
        while told := os.read(self._read, 1):
            if told[0] != signal.SIGINT:
                continue
            self._signals += 1
            unseen = self._signals - self._seen > int(self.kept)
            if not self._over.wait(GRACE_S) and (self.came or (unseen and self._signals > self._seen)):
                with _writing:
                    leave()
        os.close(self._read)


_endings: list[Callable[[], None]] = []


def at_end(call: Callable[[], None]) -> None:
    """Have something called when this process ends, by itself or by Ctrl-C, whatever its threads do then.

    Args:
        call: Called once at least, in any thread; returns soon.
    """
    _endings.append(call)
    atexit.register(call)


def leave(line: str | None = None) -> NoReturn:
    """End the process at once, with its one line; threads that still compute are not waited for."""
    if line is None:
        line = f"error: {reason()}\n"
    for call in _endings:
        with contextlib.suppress(Exception):  # nothing may keep the process from ending
            call()
    with contextlib.suppress(OSError):
        os.write(2, (SHOW_CURSOR + line if os.isatty(2) else line).encode())
    os._exit(INTERRUPTED)


def _guard() -> _Guard | None:
    handler = signal.getsignal(signal.SIGINT)
    return handler if isinstance(handler, _Guard) else None


@contextlib.contextmanager
def minded() -> Iterator[None]:
    """End the block by ``KeyboardInterrupt`` where Ctrl-C came, even if a library has swallowed it.

    Only the main thread may ask for it; inside another such block it watches nothing anew. Where something
    else than Python's own handler is set (a shell has a job in the background ignore Ctrl-C), that stays.

    Raises:
        KeyboardInterrupt: If Ctrl-C came, and not to a search that keeps what it found.
    """
    before = signal.getsignal(signal.SIGINT)
    guard = before if isinstance(before, _Guard) else None
    if guard is None and before is not signal.default_int_handler:
        yield
        return
    outermost = guard is None
    guard = guard or _Guard()
    if outermost:
        advise("")
        guard.begin()
    try:
        yield
    except BaseException as left:
        if guard.came or (guard.given and _from_ctrl_c(left)):
            raise KeyboardInterrupt from None
        raise
    else:
        if guard.came:
            raise KeyboardInterrupt
    finally:
        guard.came = guard.given = guard.kept = False
        if outermost:
            guard.end()


def _from_ctrl_c(fault: BaseException | None) -> bool:
    """Whether an exception was made of Ctrl-C: typer ends by ``SystemExit``, without a word."""
    while fault is not None and not isinstance(fault, KeyboardInterrupt):
        fault = fault.__cause__ or fault.__context__
    return fault is not None


def keep(wanted: bool = True) -> None:
    """Say that what is under way is worth keeping: Ctrl-C then stops that alone, a second one the command.

    What is under way catches ``KeyboardInterrupt`` once; call this with False when it has ended.
    """
    guard = _guard()
    if guard is not None and guard.kept != wanted:
        guard.kept, guard.given = wanted, False


def advise(advice: str) -> None:
    """Set what the line of a command that Ctrl-C ends says in addition, until the command ends.

    Args:
        advice: How to resume the command, for example; empty for none.
    """
    global _advice  # noqa: PLW0603 (there is one command in a process, and one line)
    _advice = advice


def reason() -> str:
    """Text of the line of a command that Ctrl-C ends."""
    return f"interrupted: {_advice}" if _advice else "interrupted"


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C back until the block is done, for libraries that it would leave locked.

    Elsewhere than in the main thread, which alone is interrupted, nothing has to be done.

    Raises:
        KeyboardInterrupt: Before the block, if Ctrl-C came and was swallowed; behind it, if it came in it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    guard = _guard()
    if guard is not None and guard.came:
        raise KeyboardInterrupt
    came: list[int] = []
    with _writing:
        before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler if before is None else before)
    if came:
        signal.raise_signal(signal.SIGINT)
