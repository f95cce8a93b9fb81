"""Handling of Ctrl-C: a command ends with one line and exit code 130, whatever it is doing.

Python raises ``KeyboardInterrupt`` in the main thread. During an import or a callback, a C++ library may
treat the exception as an error of its own and continue; while such a library computes, nothing is raised. A
thread therefore watches the signals, and ends the process if the main thread has not ended after a second.
Files are written atomically, so that none is incomplete afterwards.
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
"""Exit code after Ctrl-C, by the convention of shells."""
SHOW_CURSOR = "\r\x1b[2K\x1b[?25h"
"""Terminal codes that clear the line and show the cursor, which a spinner may have hidden."""
GRACE_S = 1.0
"""Time for the main thread to end by itself [s]."""

_advice = ""
_writing = threading.RLock()
"""Lock of :func:`uninterrupted`: the watching thread does not end the process while it is held."""


class _Guard:
    """Handler of SIGINT that raises ``KeyboardInterrupt`` and records it, and a thread that watches it."""

    def __init__(self) -> None:
        self.keeps_result = False  # the next Ctrl-C stops only the search, whose result so far is kept
        self.search_stopped = False  # that Ctrl-C has been handled
        self.command_stopped = False  # a Ctrl-C that ends the command has been handled
        # signals received by the pipe, and signals handled in the main thread
        self._signals = self._handled = 0
        self._over = threading.Event()
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)

    def __call__(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 (its signature)
        """Record the signal and raise ``KeyboardInterrupt``, as Python's own handler does."""
        self._handled += 1
        if self.keeps_result and not self.search_stopped:
            self.search_stopped = True
        else:
            self.command_stopped = True
        raise KeyboardInterrupt

    def begin(self) -> None:
        """Handle SIGINT, and start the watching thread.

        The signal is written to a pipe even while the main thread computes in a library.
        """
        signal.signal(signal.SIGINT, self)
        with contextlib.suppress(ValueError):  # Windows accepts only sockets as wakeup descriptors
            signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name="interrupts", daemon=True).start()

    def end(self) -> None:
        """Restore Python's handler and stop the watching thread."""
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with contextlib.suppress(ValueError):
            signal.set_wakeup_fd(-1)
        self._over.set()
        os.close(self._write)  # the thread reads the end of the pipe

    def _watch(self) -> None:
        while number := os.read(self._read, 1):
            if number[0] != signal.SIGINT:
                continue
            self._signals += 1
            # a first Ctrl-C to a search that keeps its result may remain unhandled longer
            unhandled = self._signals - self._handled > int(self.keeps_result)
            if not self._over.wait(GRACE_S) and (
                self.command_stopped or (unhandled and self._signals > self._handled)
            ):
                with _writing:
                    leave()
        os.close(self._read)


_endings: list[Callable[[], None]] = []


def at_end(call: Callable[[], None]) -> None:
    """Register a function to be called when this process ends, normally or by Ctrl-C.

    Args:
        call: Function that returns quickly. It is called at least once, in any thread.
    """
    _endings.append(call)
    atexit.register(call)


def leave(line: str | None = None) -> NoReturn:
    """End the process at once, with one line, without waiting for other threads.

    Args:
        line: Line for standard error; that of :func:`reason` if None.
    """
    if line is None:
        line = f"error: {reason()}\n"
    for call in _endings:
        with contextlib.suppress(Exception):  # no error may prevent the end of the process
            call()
    with contextlib.suppress(OSError):
        os.write(2, (SHOW_CURSOR + line if os.isatty(2) else line).encode())
    os._exit(INTERRUPTED)


def _guard() -> _Guard | None:
    handler = signal.getsignal(signal.SIGINT)
    return handler if isinstance(handler, _Guard) else None


@contextlib.contextmanager
def minded() -> Iterator[None]:
    """End the block by ``KeyboardInterrupt`` after Ctrl-C, even if a library has suppressed the exception.

    Only the main thread may use it. An inner block shares the watching thread of the outer one. A handler
    other than Python's own stays in place; shells, for example, let background jobs ignore SIGINT.

    Raises:
        KeyboardInterrupt: After Ctrl-C, except one that only stopped a search; see :func:`keep`.
    """
    previous = signal.getsignal(signal.SIGINT)
    guard = previous if isinstance(previous, _Guard) else None
    if guard is None and previous is not signal.default_int_handler:
        yield
        return
    outermost = guard is None
    guard = guard or _Guard()
    if outermost:
        advise("")
        guard.begin()
    try:
        yield
    except BaseException as fault:
        if guard.command_stopped or (guard.search_stopped and _from_ctrl_c(fault)):
            raise KeyboardInterrupt from None
        raise
    else:
        if guard.command_stopped:
            raise KeyboardInterrupt
    finally:
        guard.command_stopped = guard.search_stopped = guard.keeps_result = False
        if outermost:
            guard.end()


def _from_ctrl_c(fault: BaseException | None) -> bool:
    """Whether an exception was caused by Ctrl-C, which typer converts to ``SystemExit``."""
    while fault is not None and not isinstance(fault, KeyboardInterrupt):
        fault = fault.__cause__ or fault.__context__
    return fault is not None


def keep(keeps_result: bool = True) -> None:
    """Let the first Ctrl-C stop only a search, whose result so far is kept, and the second the command.

    The search catches ``KeyboardInterrupt`` once. Call the function with False when the search has ended.
    """
    guard = _guard()
    if guard is not None and guard.keeps_result != keeps_result:
        guard.keeps_result, guard.search_stopped = keeps_result, False


def advise(advice: str) -> None:
    """Set the advice in the last line of a command that Ctrl-C ends, such as how to resume the command.

    Args:
        advice: Advice; empty for none.
    """
    global _advice  # noqa: PLW0603 (one command, and one line, in each process)
    _advice = advice


def reason() -> str:
    """Text of the last line of a command that Ctrl-C ends."""
    return f"interrupted: {_advice}" if _advice else "interrupted"


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer Ctrl-C to the end of the block, for operations that must not be interrupted.

    It has no effect in other threads than the main thread, since only that is interrupted.

    Raises:
        KeyboardInterrupt: Before the block, if an earlier Ctrl-C was suppressed; after the block, if Ctrl-C
            was pressed during it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    guard = _guard()
    if guard is not None and guard.command_stopped:
        raise KeyboardInterrupt
    deferred: list[int] = []
    with _writing:
        previous = signal.signal(signal.SIGINT, lambda number, _: deferred.append(number))
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler if previous is None else previous)
    if deferred:
        signal.raise_signal(signal.SIGINT)
