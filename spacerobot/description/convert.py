"""Conversion of yourdfpy's robot to links and joints of this package."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from lxml import etree

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.description.library import yourdfpy as yp
from spacerobot.description.meshes import is_readable, missing_meshes, resolve_mesh, stand_in
from spacerobot.description.parts import Geometry, LinkShape, Mimic, UrdfJoint, UrdfLink, frozen

_SHORTEST_AXIS = 1e-9


def parse_urdf(root: etree._Element, source: Path) -> yp.Robot:
    """Parse a syntactically checked tree with yourdfpy, without loading meshes.

    Raises:
        DescriptionError: If yourdfpy rejects it.
    """
    # missing limits: 0 if one of the two is missing, as in the URDF specification; none if both are missing
    for limit in root.iterfind("joint/limit"):
        if limit.get("lower") is None and limit.get("upper") is None:
            limit.set("lower", "-inf")
            limit.set("upper", "inf")
        for attribute in ("lower", "upper"):
            limit.set(attribute, limit.get(attribute, "0"))
    try:
        text = etree.tostring(root, encoding="utf-8")  # the default, ASCII, breaks other names
        urdf = yp.URDF.load(io.BytesIO(text), build_scene_graph=False, load_meshes=False)
        urdf.validate()
    except (yp.URDFError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise DescriptionError(f"yourdfpy cannot read it: {error}", source=source) from error
    if urdf.errors:
        raise DescriptionError(f"yourdfpy finds it not valid: {urdf.errors[0].msg}", source=source)
    return urdf.robot


def convert_joint(joint: yp.Joint, source: Path) -> UrdfJoint:
    """Convert a joint and normalise its axis.

    Raises:
        DescriptionError: If the axis is zero, or the lower limit is above the upper one.
    """
    where = f"joint {joint.name!r}"
    length = float(np.linalg.norm(joint.axis))
    if joint.type != "fixed" and length < _SHORTEST_AXIS:
        raise DescriptionError("its axis is zero", source=source, where=where)
    limit = joint.limit or yp.Limit()
    bounded = joint.type in ("revolute", "prismatic")
    lower, upper = (limit.lower, limit.upper) if bounded else (-np.inf, np.inf)
    if lower > upper:
        raise DescriptionError(
            f"lower limit {lower:g} lies above upper {upper:g}", source=source, where=where
        )
    dynamics = joint.dynamics or yp.Dynamics()
    return UrdfJoint(
        name=joint.name,
        kind=joint.type,
        parent=joint.parent,
        child=joint.child,
        origin=_placement(joint.origin),
        axis=frozen(joint.axis / length if length >= _SHORTEST_AXIS else (1, 0, 0)),
        damping=float(dynamics.damping or 0),
        friction=float(dynamics.friction or 0),
        effort=np.inf if limit.effort is None else limit.effort,
        velocity=np.inf if limit.velocity is None else limit.velocity,
        lower=lower,
        upper=upper,
        mimic=None if joint.mimic is None else Mimic(**vars(joint.mimic)),
    )


def convert_links(robot: yp.Robot, source: Path) -> tuple[tuple[UrdfLink, ...], list[str]]:
    """Convert all links.

    A box replaces each missing mesh among the drawn shapes. These are the visual shapes, or the collision
    shapes if there are no visual ones. Other missing meshes are left out.

    Returns:
        tuple: The links, and a warning about missing meshes, if any.
    """
    # colours by material name: the robot's materials, then those defined in visual shapes
    shape_materials = [shape.material for link in robot.links for shape in link.visuals]
    colours: dict[str, Array] = {}
    for material in [*robot.materials, *shape_materials]:
        if material is not None and material.name and material.color is not None:
            colours.setdefault(material.name, frozen(np.clip(material.color.rgba, 0, 1)))
    shape_kind = "visual" if any(link.visuals for link in robot.links) else "collision"
    missing: dict[tuple[str, str], list[str]] = {}
    converted = []
    for link in robot.links:
        mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
        if link.inertial is not None:
            origin = _placement(link.inertial.origin)
            turn, mass, com = origin[:3, :3], link.inertial.mass, origin[:3, 3]
            if link.inertial.inertia is not None:
                inertia = turn @ link.inertial.inertia @ turn.T
                inertia = (inertia + inertia.T) / 2
        shapes: dict[str, list[LinkShape]] = {"visual": [], "collision": []}
        for kind, link_shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for shape in link_shapes:
                # None if the mesh is not found
                geometry = shape.geometry
                if geometry.box is not None:
                    geometry = Geometry("box", frozen(geometry.box.size))
                elif geometry.cylinder is not None:
                    geometry = Geometry(
                        "cylinder", frozen((geometry.cylinder.radius, geometry.cylinder.length))
                    )
                elif geometry.sphere is not None:
                    geometry = Geometry("sphere", frozen((geometry.sphere.radius,)))
                else:
                    mesh = geometry.mesh
                    scale = frozen(np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3))
                    path = resolve_mesh(mesh.filename, source)
                    geometry = None if path is None else Geometry("mesh", scale, path)
                if kind == shape_kind and (geometry is None or not is_readable(geometry)):
                    fault = "not found" if geometry is None else "cannot be read"
                    missing.setdefault((shape.geometry.mesh.filename, fault), []).append(link.name)
                    shapes[kind].append(stand_in(mass, com, inertia))
                    continue
                if geometry is None:
                    continue
                material = getattr(shape, "material", None)
                if material is None:
                    rgba = None
                elif material.color is not None:
                    rgba = frozen(np.clip(material.color.rgba, 0, 1))
                else:
                    rgba = colours.get(material.name)
                named = getattr(material, "name", None) or ""
                shapes[kind].append(LinkShape(shape.name, _placement(shape.origin), geometry, rgba, named))
        converted.append(
            UrdfLink(
                name=link.name,
                mass=mass,
                com=frozen(com),
                inertia=frozen(inertia),
                visuals=tuple(shapes["visual"]),
                collisions=tuple(shapes["collision"]),
            )
        )
    return tuple(converted), missing_meshes(missing)


def _placement(origin: Array | None) -> Array:
    return frozen(np.eye(4) if origin is None else origin)
