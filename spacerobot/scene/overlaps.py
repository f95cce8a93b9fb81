"""Bodies that begin inside one another, by their collision shapes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.scene.scene import Scene, SceneBody

DEPTH = 1e-3
"""[m] that primitives may reach into one another: shapes that touch are no overlap."""
CONTACTS = 100
"""Of two meshes, at most, whose depths are compared."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A collision shape.

    Attributes:
        link, joint: Its link, and the joint that moves it.
        geometry, placement: Coal's form of it, and where it is in the joint's frame (``pin.SE3``).
        primitive: Whether it is no mesh.
        centre, radius: Of a sphere around it, the joint's frame (3,) [m], [m].
    """

    link: str
    joint: int
    geometry: Any
    placement: Any
    primitive: bool
    centre: Array
    radius: float


def overlaps(scene: Scene) -> list[str]:
    """One warning for each pair of bodies whose collision shapes overlap at the start.

    Left out are shapes that move with a tip against those that move with what it grips. Links of one body are
    not compared, nor bodies without collision shapes.
    """
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, scene.q)
    gripped = {(grasp.tip.joint, grasp.joint) for grasp in scene.grasps}
    of_body = {body.name: list(solids(scene, body)) for body in scene.bodies}
    warnings = []
    for one, other in itertools.combinations(scene.bodies, 2):
        pairs = [
            f"{a.link} and {b.link}"
            for a, b in itertools.product(of_body[one.name], of_body[other.name])
            if not {(a.joint, b.joint), (b.joint, a.joint)} & gripped
            and overlap_depth(a, b, data.oMi[a.joint], data.oMi[b.joint])
            > (DEPTH if a.primitive and b.primitive else 0.0)
        ]
        pairs = list(dict.fromkeys(pairs))
        if pairs:
            warnings.append(
                f"{one.name} and {other.name} overlap at the start: {', '.join(pairs)}; "
                "they pass through each other, move a base or change the posture"
            )
    return warnings


def solids(scene: Scene, body: SceneBody) -> Iterator[Solid]:
    """Collision shapes of a body."""
    for link in body.description.links:
        frame = scene.model.frames[scene.model.getFrameId(f"{body.name}/{link.name}", pin.FrameType.BODY)]
        for shape in link.collisions:
            # Coal's form of it; a mesh that cannot be read has none
            if shape.geometry.mesh is not None:
                try:
                    geometry = coal.MeshLoader().load(str(shape.geometry.mesh), np.array(shape.geometry.size))
                except (RuntimeError, ValueError):
                    continue
            else:
                makers = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
                geometry = makers[shape.geometry.kind](*(float(x) for x in shape.geometry.size))
            geometry.computeLocalAABB()
            place = frame.placement * pin.SE3(np.array(shape.placement))
            centre, radius = place.act(np.array(geometry.aabb_center)), float(geometry.aabb_radius)
            primitive = shape.geometry.mesh is None
            yield Solid(link.name, int(frame.parentJoint), geometry, place, primitive, centre, radius)


def overlap_depth(one: Solid, other: Solid, *joints: Any) -> float:
    """Depth [m] by which two shapes overlap, negative where they are apart.

    Args:
        one, other: The shapes; of meshes that are apart the distance is not known, but -1.
        joints: Placements of their joints (``pin.SE3``), world axes.
    """
    at = [joint * solid.placement for joint, solid in zip(joints, (one, other), strict=True)]
    placed = [coal.Transform3s(place.rotation, place.translation) for place in at]
    if one.primitive and other.primitive:
        apart = coal.DistanceResult()
        coal.distance(one.geometry, placed[0], other.geometry, placed[1], coal.DistanceRequest(), apart)
        return -float(apart.min_distance)
    request, met = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact, request.num_max_contacts = True, CONTACTS
    if not coal.collide(one.geometry, placed[0], other.geometry, placed[1], request, met):
        return -1.0
    return max(abs(float(met.getContact(k).penetration_depth)) for k in range(met.numContacts()))
