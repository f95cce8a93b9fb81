"""Atomic writes of files, and locks of folders between processes."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

from spacerobot.common.errors import ResultError

try:
    import fcntl
except ImportError:  # Windows has no fcntl: writers are not synchronised there
    fcntl = None  # type: ignore[assignment]

StrPath: TypeAlias = str | os.PathLike[str]
"""Path as a text or path object."""
STAGE = ".spacerobot-"
"""Prefix of temporary folders in which files are prepared, possibly by another running process."""


def write_text(path: StrPath, text: str) -> None:
    """Write a text file atomically.

    Raises:
        ResultError: If the file cannot be written; an existing file is then unchanged.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: StrPath, content: bytes) -> None:
    """Write a file atomically; see :func:`write_text`.

    The target of a symbolic link is replaced, not the link. Devices and pipes are written in place.
    """
    path = Path(path)
    try:
        sink = _sink(path)
        if sink is not None:
            with open(sink, "wb") as file:  # noqa: PTH123 (may be a file descriptor)
                file.write(content)
            return
        path = path.resolve()
        path.parent.mkdir(parents=True, exist_ok=True)
        with staged(path.parent) as stage:
            prepared = stage / path.name
            prepared.write_bytes(content)
            prepared.chmod(0o644)
            prepared.replace(path)
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=path) from None


def _sink(path: Path) -> Path | int | None:
    """Device, pipe or duplicate descriptor of an open file to write in place; None for other paths."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    link = path
    while link.is_symlink():  # /dev/stdout is a link to an open file of this process, possibly a regular one
        if link.name.isdigit() and link.parent.resolve() == Path(f"/proc/{os.getpid()}/fd"):
            return os.dup(int(link.name))
        link = link.parent / link.readlink()
    return None if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else path


@contextlib.contextmanager
def readable(what: str, source: Path) -> Iterator[None]:
    """Report a missing or damaged file in one line.

    Args:
        what: Content that the file should have: ``tuning``, ``plan``.
        source: The file.

    Raises:
        ResultError: If the block fails to read it.
    """
    try:
        yield
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RuntimeError) as fault:
        raise ResultError(f"holds no {what} that can be read: {fault}", source=source) from None


@contextlib.contextmanager
def staged(home: Path) -> Iterator[Path]:
    """Temporary folder inside a folder, removed at the end of the block.

    Temporary folders of killed processes, which nobody has locked, are removed first.
    """
    for abandoned in home.glob(f"{STAGE}*"):
        with _lock(abandoned, wait=False) as is_locked:
            if is_locked:
                shutil.rmtree(abandoned, ignore_errors=True)
    with contextlib.ExitStack() as stack:
        stage = _new_stage(home, stack)
        while not stage.exists():  # removed by another writer before it was locked
            stage = _new_stage(home, stack)
        yield stage


def _new_stage(home: Path, stack: contextlib.ExitStack) -> Path:
    stage = Path(tempfile.mkdtemp(prefix=STAGE, dir=home))
    stack.callback(shutil.rmtree, stage, ignore_errors=True)
    stack.enter_context(_lock(stage))
    return stage


@contextlib.contextmanager
def locked(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Lock a folder against other processes for the block, exclusively or shared with other readers.

    On a file system without locks, the block runs without a lock.
    """
    with _lock(folder, shared=shared):
        yield


@contextlib.contextmanager
def _lock(folder: Path, *, wait: bool = True, shared: bool = False) -> Iterator[bool]:
    """Lock of a folder for the block, and whether it was acquired."""
    is_locked = False
    with contextlib.ExitStack() as stack:
        if fcntl is not None:
            with contextlib.suppress(OSError):
                handle = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, handle)
                kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
                fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
                is_locked = True
        yield is_locked
