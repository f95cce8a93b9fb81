"""Record of the pages, figures and recordings in a result's folder, which are removed with the result."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from spacerobot.common.files import StrPath, locked, write_text

DERIVED = "derived.json"
"""File in a result's folder that lists the paths and SHA-256 hashes of files made from the result."""


def note_derived(folders: Iterable[StrPath | None], paths: Iterable[StrPath]) -> None:
    """Record files that were made from results.

    Args:
        folders: Folders of the results; None for a result that is not saved.
        paths: Files. Only files inside a result's folder are recorded.

    Raises:
        ResultError: If the list cannot be written.
    """
    resolved = [Path(path).resolve() for path in paths]
    for folder in (Path(folder).resolve() for folder in folders if folder is not None):
        inside = [path for path in resolved if path.is_relative_to(folder)]
        if inside:
            with locked(folder):
                hashes = _read(folder)
                hashes |= {path.relative_to(folder).as_posix(): _sha256(path) for path in inside}
                write_text(folder / DERIVED, json.dumps(hashes, indent=2, sort_keys=True) + "\n")


def remove_derived(folder: Path) -> None:
    """Remove the recorded files of a result's folder, except files that were changed since.

    Raises:
        OSError: If a file cannot be removed.
    """
    home = folder.resolve()
    for name, sha256 in _read(folder).items():
        path = (folder / name).resolve()
        if path != home / name or not path.is_relative_to(home):  # never remove files outside the folder
            continue
        if not path.is_file() or _sha256(path) != sha256:
            continue
        path.unlink()
        if path.parent != home:
            with contextlib.suppress(OSError):
                path.parent.rmdir()  # fails unless the folder is empty
    (folder / DERIVED).unlink(missing_ok=True)


def _read(folder: Path) -> dict[str, str]:
    """Hashes of the recorded files by name; empty if the record is missing or damaged."""
    try:
        document = json.loads((folder / DERIVED).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    pairs = document.items() if isinstance(document, dict) else ()
    return {name: sha256 for name, sha256 in pairs if isinstance(sha256, str) and "\0" not in name}


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
