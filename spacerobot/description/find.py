"""Where descriptions are: a user's anywhere on disk, the shipped ones in the checkout or the wheel."""

from __future__ import annotations

from pathlib import Path

from spacerobot.errors import DescriptionError, near_names


def shipped_urdf_folder() -> Path:
    """Folder of the URDFs that ship, in an installed wheel and in a checkout alike.

    Raises
    ------
    DescriptionError
        If neither is there: the installation is incomplete.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_urdf", package.parent / "urdf"):
        if folder.is_dir():
            return folder
    raise DescriptionError("the shipped URDFs are missing; install spacerobot again", source=package)


def shipped_names() -> tuple[str, ...]:
    """File names of the URDFs that ship, sorted."""
    return tuple(sorted(path.name for path in shipped_urdf_folder().glob("*.urdf")))


def find_urdf(name: str | Path, relative_to: Path | None = None) -> Path:
    """Absolute path of the URDF that ``name`` stands for.

    Tried in this order: an absolute path; a path relative to the scenario's folder; the name of a shipped
    file, with or without ``.urdf``.

    Parameters
    ----------
    name
        What the scenario says.
    relative_to
        The scenario file or its folder; None if there is none.

    Raises
    ------
    DescriptionError
        If no such file exists; lists near shipped names.
    """
    wanted = Path(name)
    candidates = [wanted] if wanted.is_absolute() else []
    if not wanted.is_absolute():
        if relative_to is not None:
            folder = relative_to.parent if is_file(relative_to) else relative_to
            candidates.append(folder / wanted)
        if len(wanted.parts) == 1 and wanted.name != "..":
            shipped = shipped_urdf_folder()
            candidates += [shipped / wanted, shipped / f"{wanted}.urdf"]
    for candidate in candidates:
        if is_file(candidate):
            return candidate.resolve()
    place = f" in {relative_to} and among the shipped ones" if relative_to is not None else ""
    raise DescriptionError(
        f"no such URDF file{place}; {near_names(wanted.name, shipped_names())}", source=str(name) or "''"
    )


def is_file(path: Path) -> bool:
    """Whether ``path`` is a regular file; False, not an error, for a path that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
