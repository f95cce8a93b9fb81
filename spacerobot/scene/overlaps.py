"""Warnings about bodies whose collision shapes overlap at the start."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scene.scene import Scene, SceneBody

DEPTH = 1e-3
"""Depth [m] below which overlapping primitives count as touching."""
CONTACTS = 100
"""Maximum number of contact points between two meshes whose depths are compared."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Collision shape of a link.

    Attributes:
        link, joint: Name of the link, and id of the joint that moves it.
        geometry, placement: Coal's geometry, and pose in the joint's frame (``pin.SE3``).
        primitive: Whether it is not a mesh.
        centre, radius: Bounding sphere, joint's frame (3,) [m], [m].
    """

    link: str
    joint: int
    geometry: Any
    placement: Any
    primitive: bool
    centre: Array
    radius: float


def overlaps(scene: Scene) -> list[str]:
    """Warning for each pair of bodies whose collision shapes overlap at the start.

    Shapes that move with a tip are not compared with those of the object it grips. Links of one body are not
    compared, nor are bodies without collision shapes.
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
    """Depth [m] by which two shapes overlap, negative if they are separate.

    Args:
        one, other: The shapes; -1 is returned for separate ones of which one is a mesh.
        joints: Placements of their joints (``pin.SE3``), world axes.
    """
    at = [joint * solid.placement for joint, solid in zip(joints, (one, other), strict=True)]
    placed = [coal.Transform3s(place.rotation, place.translation) for place in at]
    if one.primitive and other.primitive:
        distance_result = coal.DistanceResult()
        coal.distance(
            one.geometry, placed[0], other.geometry, placed[1], coal.DistanceRequest(), distance_result
        )
        return -float(distance_result.min_distance)
    request, collision_result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact, request.num_max_contacts = True, CONTACTS
    if not coal.collide(one.geometry, placed[0], other.geometry, placed[1], request, collision_result):
        return -1.0
    return max(
        abs(float(collision_result.getContact(k).penetration_depth))
        for k in range(collision_result.numContacts())
    )
