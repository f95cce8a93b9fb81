"""Mesh files that a URDF names: found and readable, or replaced by a box."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from spacerobot.description.find import is_file
from spacerobot.description.parts import Array, Geometry, Shape, frozen

_FRAME_BOX_M = 0.05  # of a link without mass
_SHORTEST_EDGE_M, _LONGEST_EDGE_M = 5e-4, 1e3


def resolve_mesh(filename: str, urdf: Path) -> Path | None:
    """Absolute path of the mesh that a URDF names, or None if there is none.

    ``package://name/...`` is looked for in folders called ``name``: the URDF's own parents and what lies
    directly in them, the nearest first; a name never leads out of that folder. Other names are paths relative
    to the URDF's folder.
    """
    if filename.startswith("package://"):
        package, _, inside = filename.removeprefix("package://").partition("/")
        for folder in _package_folders(package, urdf):
            candidate = Path(os.path.normpath(folder / inside))
            if candidate.is_relative_to(folder) and is_file(candidate):
                return candidate
        return None
    if filename.startswith("file://"):
        filename = unquote(filename.removeprefix("file://"))
    if "://" in filename:
        return None
    candidate = urdf.parent / filename
    return candidate.resolve() if is_file(candidate) else None


def _package_folders(package: str, urdf: Path) -> list[Path]:
    """Folders called ``package`` above ``urdf`` or beside its parents, the nearest first."""
    if package in ("", ".", ".."):
        return []
    folders = []
    for parent in urdf.parents:
        folders += [parent] if parent.name == package else []
        folders.append(parent / package)
    return folders


def is_readable(path: Path, scale: Array) -> bool:
    """Whether the geometry library that Pinocchio uses can read this mesh."""
    import coal  # only descriptions with meshes pay for its import

    try:
        coal.MeshLoader().load(str(path), np.array(scale))
    except (RuntimeError, ValueError, MemoryError):
        return False
    return True


def stand_in(mass: float, com: Array, inertia: Array) -> Shape:
    """Grey uniform box of the same mass and inertia, in place of a mesh that is missing.

    Parameters
    ----------
    mass, com, inertia
        Of the link: kg; m, in the link frame (3,); kg m^2, about ``com`` in link axes (3, 3). A link without
        mass gets a small cube at its origin.
    """
    placement = np.eye(4)
    edges = np.full(3, _FRAME_BOX_M)
    if mass > 0:
        principal, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        placement[:3, :3], placement[:3, 3] = axes, com
        # Box of edges a, b, c: I_1 = m (b^2 + c^2) / 12 and so on, solved for the edges.
        with np.errstate(over="ignore", invalid="ignore"):
            squares = 6 * (principal.sum() - 2 * principal) / mass
        edges = np.sqrt(np.clip(np.nan_to_num(squares), _SHORTEST_EDGE_M**2, _LONGEST_EDGE_M**2))
    return Shape(None, frozen(placement), Geometry("box", frozen(edges)), frozen((0.6, 0.6, 0.6, 1.0)))
