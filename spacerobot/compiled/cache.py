"""Cache folder of compiled libraries and closed loops, private to the user.

An entry is one file ``<key>-<digest>.so`` (``.dylib``, ``.dll``, ``.loop``). The key is a hash of the sources
and options, the digest a hash of the file's content. A truncated or modified file is therefore recognised
before it is loaded, a file name never refers to two different libraries, and two processes can build the same
entry at the same time.
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

KEPT = 400  # entries of one suffix; older ones are removed, the least recently used first
ABANDONED_S = 86_400.0  # age at which build folders are removed: no compilation takes a day


def cache_folder() -> Path:
    """Folder ``compiled`` in ``SPACEROBOT_CACHE_DIR``, or else in the user's cache folder.

    It is created with mode 0700. Since a compiled library is code, a folder that belongs to another user, or
    that others can write, is not used. A temporary folder, removed when the process ends, replaces it, and a
    :class:`SpaceRobotWarning` states the folder and the reason.
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
    """File of a key whose content agrees with its digest; None without one.

    Entries whose content disagrees, and those that others could have written, are removed.

    Args:
        folder: Cache folder, from :func:`cache_folder`.
        key, suffix: Hexadecimal key of the entry, and suffix of its file.
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
    """Rename a new file atomically to its name in the cache, and remove old entries.

    Args:
        folder, key, suffix: As for :func:`find`.
        built: The new file, in the same folder.

    Returns:
        Path: The entry.
    """
    built.chmod(0o600)
    path = folder / f"{key}-{_digest(built)}{suffix}"
    built.replace(path)
    # Build folders of killed processes, then the least recently used entries of this suffix.
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
    """Reason why a path is not private to this user: a link, another owner, writable by others; or empty."""
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
    """Temporary folder that replaces an unsafe one, with one warning."""
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
