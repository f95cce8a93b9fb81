"""A folder of compiled libraries, and of closed loops, that belongs to this user alone.

An entry is one file ``<key>-<digest>.so`` (``.dylib``, ``.dll``, ``.loop``): the key names what it was built
from, the digest what it must hold. So a file that was cut short or changed is recognised before it is loaded,
no library is ever loaded under a name that once meant something else, and two processes that build the same
entry at once do no harm.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import shutil
import stat
import tempfile
import time
import warnings
from pathlib import Path

from spacerobot.common.errors import SpaceRobotWarning
from spacerobot.compiled.toolchain import SUFFIX

KEPT = 400  # entries of one suffix; the least recently used go first
ABANDONED_S = 86_400.0  # no compilation takes a day


def cache_folder() -> Path:
    """Folder for compiled libraries: ``SPACEROBOT_CACHE_DIR`` or the user's cache folder, if it is safe.

    It is made with mode 0700. A folder that belongs to someone else, or that others may write, is refused,
    and a private temporary folder, gone when the process ends, takes its place: a compiled library is code.
    A :class:`SpaceRobotWarning` then names the folder and the reason.
    """
    wish = os.environ.get("SPACEROBOT_CACHE_DIR")
    if wish:
        folder = Path(wish)
    else:
        import platformdirs

        folder = Path(platformdirs.user_cache_dir("spacerobot", appauthor=False))
    folder = folder.absolute() / "compiled"
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        return _instead_of(folder, f"cannot be made: {error.strerror}")
    for path in (folder.parent, folder):
        fault = _fault(path)
        if fault:
            return _instead_of(path, fault)
    return folder


def find(folder: Path, key: str, suffix: str = SUFFIX) -> Path | None:
    """File stored under a key, checked against its digest; broken entries are removed.

    Args:
        folder: What :func:`cache_folder` gave.
        key, suffix: Hexadecimal name of the entry, and what its file's name ends in.
    """
    for path in sorted(folder.glob(f"{key}-*{suffix}")):
        try:
            intact = not _fault(path) and _digest(path) == path.stem.rpartition("-")[2]
        except OSError:  # gone, or cannot be read just now: neither good nor broken
            continue
        if intact:
            with contextlib.suppress(OSError):
                os.utime(path)
            return path
        with contextlib.suppress(OSError):
            path.unlink()
    return None


def store(folder: Path, key: str, built: Path, suffix: str = SUFFIX) -> Path:
    """Move a freshly built file, which lies in the same folder, to its name in one atomic step.

    Args:
        folder, key, suffix: As for :func:`find`.
        built: The file.
    """
    built.chmod(0o600)
    path = folder / f"{key}-{_digest(built)}{suffix}"
    built.replace(path)
    # Remove the least recently used entries of a suffix, and what processes left behind that were killed.
    for old in folder.glob("buil[dt]-*"):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED_S:
                shutil.rmtree(old) if old.is_dir() else old.unlink()
    entries = []
    for old in folder.glob(f"*{suffix}"):
        with contextlib.suppress(OSError):
            entries.append((old.stat().st_mtime, old))
    for _, old in sorted(entries)[: max(0, len(entries) - KEPT)]:
        with contextlib.suppress(OSError):
            old.unlink()
    return path


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


def _fault(path: Path) -> str:
    """Reason why a path is not this user's alone (a link, another owner, open to others); empty if it is."""
    if not hasattr(os, "getuid"):
        return ""
    try:
        status = path.lstat()
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if stat.S_ISLNK(status.st_mode):
        return "is a link"
    if status.st_uid != os.getuid():
        return f"belongs to another user ({status.st_uid})"
    return "can be written by others" if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


@functools.cache
def _instead_of(path: Path, fault: str) -> Path:
    """A private folder that ends with the process, and one warning."""
    warnings.warn(
        f"cache folder {path} {fault}; what is compiled now is lost when this process ends. "
        "Mend it, or name another in SPACEROBOT_CACHE_DIR",
        SpaceRobotWarning,
        stacklevel=4,
    )
    return _private_folder()


@functools.cache
def _private_folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="spacerobot-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
