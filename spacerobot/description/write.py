"""URDF text of links and joints, written by yourdfpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from spacerobot.description.library import yourdfpy as yp
from spacerobot.description.parts import Geometry, UrdfJoint, UrdfLink

_NO_LIMIT = 1e9
"""Value of a missing limit in URDF text [SI units]."""


def urdf_xml(name: str, links: Sequence[UrdfLink], joints: Sequence[UrdfJoint], prefix: str) -> str:
    """URDF text of links and joints with prefixed names.

    Inertias are in link axes, colours are defined in the shapes, and meshes have absolute paths.
    """
    elements, joint_elements = [], []
    for link in links:
        inertial, visuals = None, []
        if link.mass > 0:
            at_com = np.eye(4)
            at_com[:3, 3] = link.com
            inertial = yp.Inertial(origin=at_com, mass=link.mass, inertia=link.inertia)
        for shape in link.visuals:
            # named by its colour: readers use the first of several materials with the same name for all
            material = None
            if shape.rgba is not None:
                named = "rgba_" + "_".join(f"{value:g}" for value in shape.rgba)
                material = yp.Material(name=named, color=yp.Color(shape.rgba))
            visuals.append(yp.Visual(shape.name, shape.placement, _geometry(shape.geometry), material))
        collisions = [yp.Collision(s.name, s.placement, _geometry(s.geometry)) for s in link.collisions]
        elements.append(yp.Link(prefix + link.name, inertial, visuals, collisions))
    for joint in joints:
        limits = {
            "effort": joint.effort,
            "velocity": joint.velocity,
            "lower": joint.lower,
            "upper": joint.upper,
        }
        finite = {key: value for key, value in limits.items() if np.isfinite(value)}
        moves = joint.kind != "fixed"
        if joint.kind in ("revolute", "prismatic"):  # the parser requires all attributes of their <limit>
            finite |= {
                key: _NO_LIMIT if key != "lower" else -_NO_LIMIT for key in limits if key not in finite
            }
        joint_elements.append(
            yp.Joint(
                name=prefix + joint.name,
                type=joint.kind,
                parent=prefix + joint.parent,
                child=prefix + joint.child,
                origin=joint.origin,
                axis=joint.axis if moves else None,
                dynamics=yp.Dynamics(joint.damping, joint.friction) if moves else None,
                limit=yp.Limit(**finite) if finite and moves else None,
            )
        )
    robot = yp.Robot(name=name, links=elements, joints=joint_elements)
    urdf = yp.URDF(
        robot, build_scene_graph=False, load_meshes=False, filename_handler=yp.filename_handler_null
    )
    return str(etree.tostring(urdf.write_xml(), encoding="unicode", pretty_print=True))


def _geometry(geometry: Geometry) -> yp.Geometry:
    size = geometry.size
    if geometry.kind == "box":
        return yp.Geometry(box=yp.Box(size))
    if geometry.kind == "cylinder":
        return yp.Geometry(cylinder=yp.Cylinder(radius=size[0], length=size[1]))
    if geometry.kind == "sphere":
        return yp.Geometry(sphere=yp.Sphere(size[0]))
    return yp.Geometry(mesh=yp.Mesh(str(geometry.mesh), size))
