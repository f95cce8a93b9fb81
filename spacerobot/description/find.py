"""Search for URDF files by path, in ROS packages, and among the shipped ones."""

from __future__ import annotations

import difflib
import glob
import os
from collections.abc import Iterator
from pathlib import Path

from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.common.files import StrPath

PACKAGE = "package://"
"""Prefix of names in ROS packages."""
_WORKSPACE_DEPTH = 3  # levels of folders below an entry of ROS_PACKAGE_PATH that may be packages


def shipped_urdf_folder() -> Path:
    """Folder of the shipped URDFs, in an installed wheel or in a checkout.

    Raises:
        DescriptionError: If the folder is missing.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_urdf", package.parent / "urdf"):
        if folder.is_dir():
            return folder
    raise DescriptionError("the shipped URDFs are missing; install spacerobot again", source=package)


def shipped_names() -> tuple[str, ...]:
    """File names of the shipped URDFs in alphabetical order."""
    return tuple(sorted(path.name for path in shipped_urdf_folder().glob("*.urdf")))


def find_urdf(name: StrPath, relative_to: StrPath | None = None) -> Path:
    """Absolute path of a URDF.

    The order of the search is: a ``package://`` address or an absolute path; a path relative to the
        scenario's
    folder; the name of a shipped file, with or without ``.urdf``.

    Args:
        name: Name or path in the scenario.
        relative_to: The scenario file or its folder, or None.

    Raises:
        DescriptionError: If there is no such file; the message has similar names of shipped files.
    """
    name, relative_to = os.fspath(name), None if relative_to is None else Path(relative_to)
    if name.startswith(PACKAGE):
        path = find_in_package(name, relative_to)
        if path is None:
            raise DescriptionError(
                "no such URDF file above the scenario, in ROS_PACKAGE_PATH or in AMENT_PREFIX_PATH",
                source=str(name),
            )
        return path.resolve()
    requested = Path(name)
    candidates = [requested] if requested.is_absolute() else []
    if not requested.is_absolute():
        if relative_to is not None:
            folder = relative_to.parent if is_file(relative_to) else relative_to
            candidates.append(folder / requested)
        if len(requested.parts) == 1 and requested.name != "..":
            shipped = shipped_urdf_folder()
            candidates += [shipped / requested, shipped / f"{requested}.urdf"]
    for candidate in candidates:
        if is_file(candidate):
            return candidate.resolve()
    place = f" in {relative_to} and among the shipped ones" if relative_to is not None else ""
    # similar names, without the suffix that all of them share: in the folder that is named, and shipped ones
    beside = candidates[0].parent if candidates else Path(os.devnull)
    nearby = {each.stem: str(requested.parent / each.name) for each in _urdfs(beside)}
    known = {each.removesuffix(".urdf"): each for each in shipped_names()} | nearby
    close = difflib.get_close_matches(requested.stem, known, n=3, cutoff=0.6)
    if close:
        hint = "did you mean " + " or ".join(known[each] for each in close) + "?"
    elif len(requested.parts) > 1:
        hint = "check the path" if beside.is_dir() else f"there is no folder {requested.parent}"
    else:
        hint = near_names(requested.name, shipped_names())
    raise DescriptionError(f"no such URDF file{place}; {hint}", source=str(name) or "''")


def _urdfs(folder: Path) -> list[Path]:
    """URDFs in a folder; none if it cannot be read."""
    try:
        return sorted(folder.glob("*.urdf"))
    except (OSError, ValueError):
        return []


def find_in_package(uri: str, near: Path | None) -> Path | None:
    """Path of a file with an address ``package://name/...``; None if it is not found.

    The search covers folders called ``name``: first the parents of ``near`` and their subfolders, the nearest
    first; then folders in ``ROS_PACKAGE_PATH``, and in ``share`` of each prefix in ``AMENT_PREFIX_PATH``. The
    file must be inside that folder.
    """
    package, _, inside = uri.removeprefix(PACKAGE).partition("/")
    if package in ("", ".", ".."):
        return None
    for folder in _package_folders(package, near):
        candidate = Path(os.path.normpath(folder / inside))
        if candidate.is_relative_to(folder) and is_file(candidate):
            return candidate
    return None


def find_package(name: str, near: Path) -> Path | None:
    """Folder of a ROS package, which has a ``package.xml``, or None; see :func:`find_in_package`."""
    if name in ("", ".", "..") or Path(name).name != name:
        return None
    folders = _package_folders(name, near)
    return next((folder for folder in folders if is_file(folder / "package.xml")), None)


def _package_folders(package: str, near: Path | None) -> Iterator[Path]:
    """Iterate over possible folders of a package in the order of the search."""
    for parent in near.parents if near is not None else ():
        if parent.name == package:
            yield parent
        yield parent / package
    for entry in _entries("ROS_PACKAGE_PATH"):
        if entry.name == package:
            yield entry
        for depth in range(_WORKSPACE_DEPTH):
            yield from sorted(entry.glob("*/" * depth + glob.escape(package)))
    for entry in _entries("AMENT_PREFIX_PATH"):
        yield entry / "share" / package


def _entries(variable: str) -> list[Path]:
    """Absolute folders listed in an environment variable."""
    folders = os.environ.get(variable, "").split(os.pathsep)
    return [Path(folder).absolute() for folder in folders if folder]


def is_file(path: Path) -> bool:
    """Whether a path is a regular file; False instead of an error for an invalid path."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
