"""Files written whole or not at all."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from spacerobot.errors import ResultError


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
    except OSError as fault:
        if stage is not None:
            with contextlib.suppress(OSError):
                stage.unlink()
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=path) from None
