"""Mesh files that a URDF names: found and readable, or replaced by a box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.description.find import PACKAGE, find_in_package, is_file
from spacerobot.description.parts import Geometry, LinkShape, frozen

_FRAME_BOX_M = 0.05  # of a link without mass
_SHORTEST_EDGE_M, _LONGEST_EDGE_M = 5e-4, 1e3
_NAMED = 3  # missing meshes in a warning


def resolve_mesh(filename: str, urdf: Path) -> Path | None:
    """Absolute path of the mesh that a URDF names, or None if there is none.

    ``package://name/...`` is looked for as :func:`spacerobot.description.find.find_in_package` says. Other
    names are paths relative to the URDF's folder.
    """
    if filename.startswith(PACKAGE):
        return find_in_package(filename, urdf)
    if filename.startswith("file://"):
        filename = unquote(filename.removeprefix("file://"))
    if "://" in filename:
        return None
    candidate = urdf.parent / filename
    return candidate.resolve() if is_file(candidate) else None


def missing_meshes(missing: Mapping[tuple[str, str], Sequence[str]]) -> list[str]:
    """One warning about all meshes that are replaced by boxes; none if there are none.

    Args:
        missing: Links by file name and fault, ``not found`` or ``cannot be read``.
    """
    if not missing:
        return []
    named = [
        f"{filename!r} {fault} (link{'s' if len(links) > 1 else ''} {', '.join(links)})"
        for (filename, fault), links in list(missing.items())[:_NAMED]
    ]
    more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
    remedy = ""
    if any(name.startswith(PACKAGE) and fault == "not found" for name, fault in missing):
        remedy = "; packages are looked for above the URDF, in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH"
    return [f"a box replaces mesh {', '.join(named)}{more}{remedy}"]


def is_readable(geometry: Geometry) -> bool:
    """Whether the geometry library that Pinocchio uses can read a mesh; a primitive needs no reading."""
    if geometry.mesh is None:
        return True
    try:
        read_mesh(geometry.mesh, tuple(map(float, geometry.size)))
    except (OSError, RuntimeError, ValueError, MemoryError):
        return False
    return True


def read_mesh(path: Path, scale: tuple[float, ...]) -> Any:
    """A mesh as the geometry library has it (``coal.BVHModelBase``), read once as long as its file stays.

    Raises:
        OSError, RuntimeError, ValueError, MemoryError: It cannot be read.
    """
    status = path.stat()
    return _read(path, scale, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=256)
def _read(path: Path, scale: tuple[float, ...], _written_ns: int, _bytes: int) -> Any:
    import coal  # only descriptions with meshes pay for its import

    mesh = coal.MeshLoader().load(str(path), np.array(scale))
    if not np.isfinite(mesh.vertices()).all():
        raise ValueError("a vertex is not finite")
    return mesh


def stand_in(mass: float, com: Array, inertia: Array) -> LinkShape:
    """Grey uniform box of the same mass and inertia, in place of a mesh that is missing.

    Args:
        mass, com, inertia: Of the link: kg; m, in the link frame (3,); kg m^2, about ``com`` in link axes (3,
            3). A link without mass gets a small cube at its origin.
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
    return LinkShape(None, frozen(placement), Geometry("box", frozen(edges)), frozen((0.6, 0.6, 0.6, 1.0)))
