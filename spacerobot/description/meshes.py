"""Mesh files of a URDF: search, reading, and boxes that replace missing ones."""

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

_FRAME_BOX_M = 0.05  # edge of the box of a link without mass
_SHORTEST_EDGE_M, _LONGEST_EDGE_M = 5e-4, 1e3
_NAMED = 3  # maximum number of missing meshes that a warning names


def resolve_mesh(filename: str, urdf: Path) -> Path | None:
    """Absolute path of a mesh file of a URDF; None if it is not found.

    Addresses ``package://name/...`` are searched by :func:`spacerobot.description.find.find_in_package`.
    Other names are paths, relative to the URDF's folder.
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
    """Warning about the meshes that are replaced by boxes; empty without any.

    Args:
        missing: Names of links by file name and reason, ``not found`` or ``cannot be read``.
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
    """Whether coal, Pinocchio's geometry library, can read the mesh; true for primitives."""
    if geometry.mesh is None:
        return True
    try:
        read_mesh(geometry.mesh, tuple(map(float, geometry.size)))
    except (OSError, RuntimeError, ValueError, MemoryError):
        return False
    return True


def read_mesh(path: Path, scale: tuple[float, ...]) -> Any:
    """Read a mesh as a ``coal.BVHModelBase``, cached while the file is unchanged.

    Raises:
        OSError, RuntimeError, ValueError, MemoryError: If the mesh cannot be read.
    """
    status = path.stat()
    return _read(path, scale, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=256)
def _read(path: Path, scale: tuple[float, ...], _written_ns: int, _bytes: int) -> Any:
    import coal  # imported only for descriptions with meshes

    mesh = coal.MeshLoader().load(str(path), np.array(scale))
    if not np.isfinite(mesh.vertices()).all():
        raise ValueError("a vertex is not finite")
    return mesh


def stand_in(mass: float, com: Array, inertia: Array) -> LinkShape:
    """Grey uniform box with the mass and inertia of a link, which replaces a missing mesh.

    A link without mass gets a small cube at its origin.

    Args:
        mass: Mass of the link [kg].
        com: Centre of mass, link frame (3,) [m].
        inertia: Inertia about the centre of mass, link axes (3, 3) [kg m^2].
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
