"""Links and joints to URDF text, with every name prefixed; yourdfpy does the writing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from spacerobot.description.library import yourdfpy as yp
from spacerobot.description.parts import Geometry, UrdfJoint, UrdfLink

_NO_LIMIT = 1e9
"""Number that stands for no limit [SI]."""


def urdf_xml(name: str, links: Sequence[UrdfLink], joints: Sequence[UrdfJoint], prefix: str) -> str:
    """URDF of these links and joints, each named ``prefix`` + its own name.

    Inertias are written in link axes, colours inside the shape that has them, meshes by absolute path.
    """
    elements, held = [], []
    for link in links:
        inertial, visuals = None, []
        if link.mass > 0:
            at_com = np.eye(4)
            at_com[:3, 3] = link.com
            inertial = yp.Inertial(origin=at_com, mass=link.mass, inertia=link.inertia)
        for shape in link.visuals:
            # named after its colour: of two materials with the same name, readers take the first for both
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
        if joint.kind in ("revolute", "prismatic"):  # whose <limit> the parser needs with all attributes
            finite |= {
                key: _NO_LIMIT if key != "lower" else -_NO_LIMIT for key in limits if key not in finite
            }
        held.append(
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
    robot = yp.Robot(name=name, links=elements, joints=held)
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
