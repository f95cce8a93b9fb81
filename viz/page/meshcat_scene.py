"""Bodies as plain data, from which the page builds MeshCat objects."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spacerobot.result import Result
from spacerobot.scene import Scene
from viz.drawing.meshes import mesh_file, shown_meshes
from viz.drawing.motion import BodyMotion, DrawnSolid, Node

DIGITS = 7
"""Significant digits of numbers in text form, those of single precision."""


Packed = np.ndarray[Any, np.dtype[np.float32]]
"""Numbers for transmission: single precision, row by row, little-endian."""


def packed(values: ArrayLike) -> Packed:
    """Numbers to be sent."""
    return np.ascontiguousarray(values, dtype="<f4")


def encoded(array: np.ndarray[Any, Any]) -> str:
    """Bytes of an array in base 64."""
    return base64.b64encode(array.tobytes()).decode("ascii")


def rounded(values: ArrayLike) -> list[float]:
    """Numbers with as many digits as single precision holds."""
    return [float(f"{value:.{DIGITS}g}") for value in np.asarray(values, dtype=np.float64).ravel()]


class Meshes:
    """Meshes of a page, each stored once for all solids that use it.

    Args:
        nodes: All nodes of the page.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        solids = (solid.geometry for node in nodes for solid in node.solids)
        self._surfaces = shown_meshes(mesh_file(shape) for shape in solids if shape.kind == "mesh")
        self._places = {file: k for k, file in enumerate(self._surfaces)}

    def data(self) -> list[dict[str, str]]:
        """Vertices and triangles of each, and the triangles' colours, empty where its file gives none."""
        return [
            {
                "vertices": encoded(packed(surface.vertices)),
                "triangles": encoded(surface.triangles.astype("<u4")),
                "colours": "" if surface.colours is None else encoded(surface.colours),
            }
            for surface in self._surfaces.values()
        ]

    def node_data(self, nodes: Sequence[Node]) -> list[dict[str, Any]]:
        """Solids of each node, the body it belongs to, its label, and whether it is that body's root."""
        places = self._places
        return [
            {
                "body": node.body,
                "label": node.label,
                "base": node.is_base,
                "solids": [
                    solid_data(solid)
                    | ({"mesh": places[mesh_file(shape)]} if (shape := solid.geometry).kind == "mesh" else {})
                    for solid in node.solids
                ],
            }
            for node in nodes
        ]


def solid_data(solid: DrawnSolid) -> dict[str, Any]:
    """Kind, size, colour and placement (column by column) of a solid."""
    return {
        "kind": solid.geometry.kind,
        "size": rounded(solid.geometry.size),
        "rgba": rounded(solid.rgba),
        "finish": solid.finish,
        "matrix": rounded(solid.placement.T),
    }


def poses(motion: BodyMotion) -> Packed:
    """Position and quaternion (x, y, z, w) of each node at each time, packed (nt, nodes, 7)."""
    return packed(np.concatenate([motion.position, motion.quaternion], axis=-1))


def changed_descriptions(result: Result, scene: Scene) -> list[str]:
    """Bodies whose URDF differs from the simulated one, one line each."""
    recorded = result.summary.get("urdf_sha256", {})
    return [
        f"{body.name}: {body.description.path.name} has changed since the run; what is drawn may differ"
        for body in scene.bodies
        if recorded.get(body.name, body.description.sha256) != body.description.sha256
    ]


def script_hash(text: str) -> str:
    """Source expression by which a Content Security Policy admits exactly this script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}'"
