"""Search of robot descriptions: a user's anywhere on disk, the shipped ones in the checkout or the wheel."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator
from pathlib import Path

from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.common.files import StrPath

PACKAGE = "package://"
"""Begin of names in a ROS package."""
_WORKSPACE_DEPTH = 3  # of packages below an entry of ROS_PACKAGE_PATH


def shipped_urdf_folder() -> Path:
    """Folder of the URDFs that ship, in an installed wheel and in a checkout alike.

    Raises:
        DescriptionError: If neither is there: the installation is incomplete.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_urdf", package.parent / "urdf"):
        if folder.is_dir():
            return folder
    raise DescriptionError("the shipped URDFs are missing; install spacerobot again", source=package)


def shipped_names() -> tuple[str, ...]:
    """File names of the URDFs that ship, sorted."""
    return tuple(sorted(path.name for path in shipped_urdf_folder().glob("*.urdf")))


def find_urdf(name: StrPath, relative_to: StrPath | None = None) -> Path:
    """Absolute path of the URDF with a name.

    Tried in this order: an absolute path or one in a package; a path relative to the scenario's folder; the
    name of a shipped file, with or without ``.urdf``.

    Args:
        name: What the scenario says.
        relative_to: The scenario file or its folder; None if there is none.

    Raises:
        DescriptionError: If no such file exists; lists near shipped names.
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
    raise DescriptionError(
        f"no such URDF file{place}; {near_names(requested.name, shipped_names())}", source=str(name) or "''"
    )


def find_in_package(uri: str, near: Path | None) -> Path | None:
    """Path of the file of a ``package://name/...`` address, or None if there is none.

    Looked for in folders called ``name``: the parents of ``near`` and what lies directly in them, the
    nearest first; then what is in ``ROS_PACKAGE_PATH``, and ``share`` in each prefix of
    ``AMENT_PREFIX_PATH``. A name never leads out of that folder.
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
    """Folder of a ROS package, known by its ``package.xml``, or None; see :func:`find_in_package`."""
    if name in ("", ".", "..") or Path(name).name != name:
        return None
    folders = _package_folders(name, near)
    return next((folder for folder in folders if is_file(folder / "package.xml")), None)


def _package_folders(package: str, near: Path | None) -> Iterator[Path]:
    """Folders called ``package``, in the order in which they are tried."""
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
    """Absolute folders that an environment variable lists."""
    folders = os.environ.get(variable, "").split(os.pathsep)
    return [Path(folder).absolute() for folder in folders if folder]


def is_file(path: Path) -> bool:
    """Whether ``path`` is a regular file; False, not an error, for a path that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
