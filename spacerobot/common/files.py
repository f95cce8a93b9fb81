"""Files written whole or not at all, one writer after the other."""

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
except ImportError:  # Windows has none; there, writers are not kept apart
    fcntl = None  # type: ignore[assignment]

StrPath: TypeAlias = str | os.PathLike[str]
"""A path as users give it."""
STAGE = ".spacerobot-"
"""Beginning of the names of folders in which files are prepared, perhaps by another process just now."""


def write_text(path: StrPath, text: str) -> None:
    """Write a text file atomically.

    Raises:
        ResultError: If it cannot be written; what was there before is then still there.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: StrPath, content: bytes) -> None:
    """Write a file atomically; see :func:`write_text`.

    What a symbolic link names is written, and the link stays; a device or a pipe takes the bytes.
    """
    path = Path(path)
    try:
        sink = _sink(path)
        if sink is not None:
            with open(sink, "wb") as file:  # noqa: PTH123 (perhaps the number of an open file)
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
    """Target that is written to in place: a device, a pipe, or a copy of an open file of this process."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    link = path
    while link.is_symlink():  # /dev/stdout leads to an open file of ours, perhaps a regular one
        if link.name.isdigit() and link.parent.resolve() == Path(f"/proc/{os.getpid()}/fd"):
            return os.dup(int(link.name))
        link = link.parent / link.readlink()
    return None if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else path


@contextlib.contextmanager
def staged(home: Path) -> Iterator[Path]:
    """Temporary folder in another one, gone afterwards; those that killed processes left there go first."""
    for left in home.glob(f"{STAGE}*"):
        with _held(left, wait=False) as mine:
            if mine:
                shutil.rmtree(left, ignore_errors=True)
    with contextlib.ExitStack() as stack:
        stage = _new_stage(home, stack)
        while not stage.exists():  # removed by another writer before it was held
            stage = _new_stage(home, stack)
        yield stage


def _new_stage(home: Path, stack: contextlib.ExitStack) -> Path:
    stage = Path(tempfile.mkdtemp(prefix=STAGE, dir=home))
    stack.callback(shutil.rmtree, stage, ignore_errors=True)
    stack.enter_context(_held(stage))
    return stage


@contextlib.contextmanager
def locked(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Wait until no other process holds the folder, then hold it: alone, or together with other readers.

    A file system without locks is used without them.
    """
    with _held(folder, shared=shared):
        yield


@contextlib.contextmanager
def _held(folder: Path, *, wait: bool = True, shared: bool = False) -> Iterator[bool]:
    """A lock on a folder while the block runs, and whether there is one."""
    held = False
    with contextlib.ExitStack() as stack:
        if fcntl is not None:
            with contextlib.suppress(OSError):
                handle = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, handle)
                kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
                fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
                held = True
        yield held
