"""Pages, figures and recordings in a result's folder: they go when another result takes its place."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from spacerobot.common.files import StrPath, locked, write_text

DERIVED = "derived.json"
"""File that lists what was made from a result and lies in its folder, by path, with the sha256 of each."""


def note_derived(folders: Iterable[StrPath | None], paths: Iterable[StrPath]) -> None:
    """Record which files were made from results.

    Args:
        folders: Folders of the results; None for a result that was not saved, which has nothing to record.
        paths: Files; those outside of a result's folder are not recorded for it.

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
    """Remove what was made from a folder's result; files changed since are somebody's own and stay.

    Raises:
        OSError: If a file cannot be removed.
    """
    home = folder.resolve()
    for name, sha256 in _read(folder).items():
        path = (folder / name).resolve()
        if path != home / name or not path.is_relative_to(home):  # the list is no reason to reach elsewhere
            continue
        if not path.is_file() or _sha256(path) != sha256:
            continue
        path.unlink()
        if path.parent != home:
            with contextlib.suppress(OSError):
                path.parent.rmdir()  # only where nothing else is left in it
    (folder / DERIVED).unlink(missing_ok=True)


def _read(folder: Path) -> dict[str, str]:
    """Hashes of the listed files by name; empty where the list is missing or damaged."""
    try:
        document = json.loads((folder / DERIVED).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    pairs = document.items() if isinstance(document, dict) else ()
    return {name: sha256 for name, sha256 in pairs if isinstance(sha256, str) and "\0" not in name}


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
