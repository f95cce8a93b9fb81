"""Bodies that begin inside one another, by their collision shapes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from spacerobot.description.parts import Geometry
from spacerobot.scene.scene import Scene, SceneBody

DEPTH = 1e-3
"""[m] that primitives may reach into one another: shapes that touch are no overlap."""
NAMED = 3  # pairs of links in a warning


def overlaps(scene: Scene) -> list[str]:
    """One warning for each pair of bodies whose collision shapes overlap at the start.

    Left out are shapes that move with a tip against those that move with what it grips. Links of one body are
    not compared, nor bodies without collision shapes.
    """
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    gripped = {(grasp.tip.joint, grasp.joint) for grasp in scene.grasps}
    solids = {body.name: list(_solids(scene, data, body)) for body in scene.bodies}
    found = []
    for one, other in itertools.combinations(scene.bodies, 2):
        pairs = [
            f"{a.link} and {b.link}"
            for a, b in itertools.product(solids[one.name], solids[other.name])
            if not {(a.joint, b.joint), (b.joint, a.joint)} & gripped and _meet(a, b)
        ]
        pairs = list(dict.fromkeys(pairs))
        if pairs:
            more = f" and {len(pairs) - NAMED} more" if len(pairs) > NAMED else ""
            found.append(
                f"{one.name} and {other.name} overlap at the start: {', '.join(pairs[:NAMED])}{more}; "
                "they pass through each other, move a base or change the posture"
            )
    return found


@dataclass(frozen=True)
class _Solid:
    """A collision shape: its link, the joint that moves it, its geometry, and where it is."""

    link: str
    joint: int
    geometry: Any
    placement: Any
    primitive: bool


def _solids(scene: Scene, data: Any, body: SceneBody) -> Iterator[_Solid]:
    for link in body.description.links:
        frame = scene.model.getFrameId(f"{body.name}/{link.name}", pin.FrameType.BODY)
        for shape in link.collisions:
            geometry = _geometry(shape.geometry)
            if geometry is not None:
                at = data.oMf[frame] * pin.SE3(np.array(shape.placement))
                placement = coal.Transform3s(at.rotation, at.translation)
                joint = int(scene.model.frames[frame].parentJoint)
                yield _Solid(link.name, joint, geometry, placement, shape.geometry.mesh is None)


def _geometry(geometry: Geometry) -> Any:
    """Coal's form of a shape; None for a mesh that cannot be read."""
    if geometry.mesh is not None:
        try:
            return coal.MeshLoader().load(str(geometry.mesh), np.array(geometry.size))
        except (RuntimeError, ValueError):
            return None
    makers = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
    return makers[geometry.kind](*(float(x) for x in geometry.size))


def _meet(a: _Solid, b: _Solid) -> bool:
    request = coal.CollisionRequest()
    if a.primitive and b.primitive:
        request.security_margin = -DEPTH
    result = coal.CollisionResult()
    return bool(coal.collide(a.geometry, a.placement, b.geometry, b.placement, request, result))
