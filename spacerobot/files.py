"""Files written whole or not at all, one writer after the other, and not torn by Ctrl-C."""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spacerobot.errors import ResultError

try:
    import fcntl
except ImportError:  # Windows has none; there, writers are not kept apart
    fcntl = None  # type: ignore[assignment]


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically.

    Raises
    ------
    ResultError
        If it cannot be written; what was there before is then still there.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically; see :func:`write_text`."""
    stage: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}-", delete=False) as file:
            stage = Path(file.name)
            file.write(content)
        stage.chmod(0o644)
        stage.replace(path)
    except BaseException as fault:
        if stage is not None:
            with contextlib.suppress(OSError):
                stage.unlink()
        if not isinstance(fault, OSError):
            raise
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=path) from None


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C back until the block is done, for libraries that it would leave locked.

    Elsewhere than in the main thread, which alone is interrupted, nothing has to be done.

    Raises
    ------
    KeyboardInterrupt
        Behind the block, if Ctrl-C came in it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before: Any = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler if before is None else before)
        if came:
            signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def locked(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Wait until no other process holds the folder, then hold it: alone, or together with other readers.

    A file system without locks is used without them.
    """
    with contextlib.ExitStack() as stack:
        if fcntl is not None:
            with contextlib.suppress(OSError):
                handle = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, handle)
                fcntl.flock(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield
