"""Motions and shapes of all links, each relative to its parent link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scene import Scene

if TYPE_CHECKING:
    from viz.drawing.motion import DrawnSolid

WORLD = "world"
"""Name of the inertial frame."""


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Motion of a link relative to its parent.

    Attributes:
        name: Name of the link, such as ``servicer/left_link_1``.
        parent: Name of the parent link; :data:`WORLD` for the root of a body.
        position: Origin of the link in the parent's frame (nt, 3) [m].
        quaternion: Rotation from the link's to the parent's axes (nt, 4), x, y, z, w, without changes of
            sign.
        solids: Visual shapes in the link's frame; collision shapes for a body without visual ones.
    """

    name: str
    parent: str
    position: Array
    quaternion: Array
    solids: tuple[DrawnSolid, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether the link does not move relative to its parent."""
        constant: bool = (self.position == self.position[0]).all() and (
            self.quaternion == self.quaternion[0]
        ).all()
        return bool(constant)


def link_motions(scene: Scene, q: Array) -> list[LinkMotion]:
    """Motion of every link of a scene, parents first.

    Args:
        scene: The scene.
        q: Configurations (nt, nq).
    """
    from spacerobot.dynamics.joints import read_joints
    from viz.drawing.motion import GREY, DrawnSolid, finish_of
    from viz.drawing.placements import joint_placements, quaternions

    joints, motions = joint_placements(scene, read_joints(scene.model), q), list[LinkMotion]()
    for body in scene.bodies:
        links = {link.name: link for link in body.description.links}
        parents = {joint.child: joint.parent for joint in body.description.joints}
        has_visuals = any(link.visuals for link in links.values())
        rotation, origin = dict[str, Array](), dict[str, Array]()
        for name in _parents_first(links, parents):
            frame = scene.model.frames[scene.model.getFrameId(f"{body.name}/{name}", pin.FrameType.BODY)]
            joint = int(frame.parentJoint)
            rotation[name] = joints.rotation[:, joint] @ frame.placement.rotation
            origin[name] = joints.points(joint, frame.placement.translation)
            turned, moved = rotation[name], origin[name]
            if name in parents:
                # parent_R_link = parent_R^T R; for a link fixed to its parent, the constant product of the
                # two frame placements, without rounding errors of the motion
                above = parents[name]
                parent_frame = scene.model.frames[
                    scene.model.getFrameId(f"{body.name}/{above}", pin.FrameType.BODY)
                ]
                if int(parent_frame.parentJoint) == joint:
                    fixed = parent_frame.placement.actInv(frame.placement)
                    turned = np.broadcast_to(fixed.rotation, turned.shape)
                    moved = np.broadcast_to(fixed.translation, moved.shape)
                else:
                    back = rotation[above].swapaxes(-1, -2)
                    turned = back @ turned
                    moved = np.einsum("tij,tj->ti", back, moved - origin[above])
            quaternion = quaternions(np.ascontiguousarray(turned))
            signs = np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=-1) < 0, -1.0, 1.0)
            quaternion[1:] *= np.cumprod(signs)[:, None]
            link = links[name]
            solids = tuple(
                DrawnSolid(
                    shape.placement,
                    shape.geometry,
                    GREY if shape.rgba is None else shape.rgba,
                    finish_of(shape.material),
                )
                for shape in (link.visuals if has_visuals else link.collisions)
            )
            parent = f"{body.name}/{parents[name]}" if name in parents else WORLD
            motions.append(LinkMotion(f"{body.name}/{name}", parent, moved, quaternion, solids))
    return motions


def _parents_first(links: Any, parents: dict[str, str]) -> list[str]:
    """Names of links in an order in which parents precede their children."""
    ordered = list[str]()
    for name in links:
        chain = [name]
        while chain[-1] in parents and parents[chain[-1]] not in ordered:
            chain.append(parents[chain[-1]])
        ordered += [one for one in reversed(chain) if one not in ordered]
    return ordered


def pose_of(placement: Array) -> tuple[list[float], list[float]]:
    """Position [m] and quaternion (x, y, z, w) of a homogeneous matrix (4, 4)."""
    from viz.drawing.placements import quaternions

    return placement[:3, 3].tolist(), quaternions(placement[:3, :3]).tolist()
