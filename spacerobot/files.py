"""Files written whole or not at all, one writer after the other."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

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
