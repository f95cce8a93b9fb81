"""Conversion of MJCF, MuJoCo's format, to links and joints of a URDF.

A body with several joints becomes a chain of links, all but the last without mass. Sites become links on
fixed joints, so that they can be tips. Warnings name elements without a counterpart in URDF.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.description.meshes import is_readable, missing_meshes, stand_in
from spacerobot.description.mjcf_tree import ACTUATORS, MjcfTree, read_tree, rotation_to
from spacerobot.description.parts import Geometry, JointKind, LinkShape, Mimic, UrdfJoint, UrdfLink, frozen

WORLD = "world"
DENSITY = 1000.0
"""MuJoCo's default density of geometries [kg/m^3]."""
STRUCTURES = ("replicate", "attach", "composite", "flexcomp")
"""Elements that generate bodies and are not supported."""
UNREAD = ("tendon", "sensor", "contact", "deformable", "skin", "keyframe", "extension", "custom")
"""Ignored sections, without a counterpart in URDF."""


@dataclass(eq=False)
class MjcfModel:
    """Links and joints that have been read from a model.

    Attributes:
        tree: Elements of the model.
        links, joints: Links and joints, parents first.
        ignored: Names of elements with properties that have no counterpart, by the property.
        missing: Names of links by file name and fault of a mesh that is replaced by a box.
        names: Names of links and joints in use.
    """

    tree: MjcfTree
    links: list[UrdfLink] = field(default_factory=list)
    joints: list[UrdfJoint] = field(default_factory=list)
    ignored: dict[str, list[str]] = field(default_factory=dict)
    missing: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    names: set[str] = field(default_factory=set)

    def ignore(self, what: str, who: str) -> None:
        """Record a property without a counterpart (``what``) of an element (``who``)."""
        self.ignored.setdefault(what, []).append(who)

    def name(self, element: Any, fallback: str) -> str:
        """Unique name of an element that becomes a link or a joint."""
        preferred = element.get("name") or fallback
        kind = "joint" if element.tag == "joint" else "link"
        name = next(one for one in numbered(preferred) if f"{kind}:{one}" not in self.names)
        self.names.add(f"{kind}:{name}")
        return name


def numbered(name: str) -> Iterator[str]:
    """Iterate over a name and the name with the suffixes ``_1``, ``_2``, ..."""
    yield from itertools.chain([name], (f"{name}_{k}" for k in itertools.count(1)))


@dataclass(frozen=True, eq=False)
class _Mass:
    """Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m^2], in one frame."""

    mass: float
    com: Array
    inertia: Array

    def moved(self, placement: Array) -> _Mass:
        """Mass properties in another frame; ``placement`` (4, 4) is the pose of the present frame in it."""
        turn = placement[:3, :3]
        return _Mass(self.mass, turn @ self.com + placement[:3, 3], turn @ self.inertia @ turn.T)


def read_mjcf(data: bytes, source: Path) -> tuple[MjcfModel, str]:
    """Read links and joints of an MJCF file, and the name of the model.

    Args:
        data: Bytes of the file.
        source: Path of the file.

    Raises:
        DescriptionError: If the model has no bodies, or unsupported elements: ball joints, free joints of
            nested bodies, generated bodies, bodies whose inertia would follow from a mesh.
    """
    tree = read_tree(data, source)
    model = MjcfModel(tree)
    for structure in STRUCTURES:
        for element in tree.root.iter(structure):
            raise tree.error(element, "is not read; write the bodies out, as `mj_saveLastXML` does")
    for section in UNREAD:
        if any(len(part) for part in tree.root.iterfind(section)):
            model.ignore("without a counterpart", f"<{section}>")
    world = list(tree.root.iterfind("worldbody"))
    tops = [body for part in world for body in part.iter("body") if _above(body) is None]
    if not tops:
        raise DescriptionError("holds no body", source=source)
    moves = any(not _is_free(top) and _joint_elements(top) for top in tops)
    if len(tops) == 1 and not moves:
        # the base, whose pose is that of the scenario
        _read_body(model, tops[0], None, np.eye(4), "main")
    else:
        model.links.append(UrdfLink(WORLD, 0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3)))))
        model.names.add(f"link:{WORLD}")
        for part in world:
            _read_children(model, part, WORLD, np.eye(4), "main")
    _read_equalities(model)
    _read_actuators(model)
    return model, tree.root.get("model") or source.stem


def warnings_of(model: MjcfModel) -> list[str]:
    """Warnings about properties without a counterpart and about missing meshes."""
    lines = []
    for what, who in model.ignored.items():
        names = list(dict.fromkeys(who))
        lines.append(f"ignored, {what}: {', '.join(names)}")
    return lines + missing_meshes(model.missing)


def _above(element: Any) -> Any:
    """Body that contains an element; None if it is not in a body."""
    return next(element.iterancestors("body"), None)


def _joint_elements(body: Any) -> list[Any]:
    return [child for child in body if child.tag == "joint"]


def _is_free(body: Any) -> bool:
    return any(
        child.tag == "freejoint" or child.get("type") == "free" for child in body if child.tag != "body"
    )


def _read_children(model: MjcfModel, element: Any, parent: str, offset: Array, childclass: str) -> None:
    """Read the bodies and sites inside a body, the world or a ``<frame>``.

    Args:
        model: Model to which links and joints are added.
        element: The element.
        parent: Name of the link to which they are attached.
        offset: Placement of the element in the frame of that link (4, 4).
        childclass: Class of defaults.
    """
    tree = model.tree
    for child in element:
        if child.tag == "frame":
            inner = offset @ tree.placement(child, childclass)
            _read_children(model, child, parent, inner, child.get("childclass") or childclass)
        elif child.tag == "body":
            _read_body(model, child, parent, offset, childclass)
        elif child.tag == "site" and child.get("name"):
            name = model.name(child, "site")
            model.links.append(UrdfLink(name, 0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3)))))
            place = offset @ tree.placement(child, childclass)
            model.joints.append(_fixed(model, name, parent, place))


def _fixed(model: MjcfModel, name: str, parent: str, placement: Array) -> UrdfJoint:
    joint = next(one for one in numbered(f"{name}_fixed") if f"joint:{one}" not in model.names)
    model.names.add(f"joint:{joint}")
    axis = frozen((1.0, 0.0, 0.0))
    return UrdfJoint(joint, "fixed", parent, name, frozen(placement), axis)


def _read_body(model: MjcfModel, body: Any, parent: str | None, offset: Array, childclass: str) -> None:
    """Read a body with its joints, shapes and nested bodies; see :func:`_read_children`."""
    tree, childclass = model.tree, body.get("childclass") or childclass
    name = model.name(body, "body")
    if _is_free(body) and parent not in (None, WORLD):
        raise tree.error(body, "has a free joint below another body")
    placement = offset @ tree.placement(body, childclass)
    joints = [one for one in _joint_elements(body) if _kind(model, one, childclass) != "free"]
    # placement of the link's frame in that of the body: its origin is at the anchor of the last joint
    link_in_body: Array = np.eye(4)
    above = parent
    for k, joint in enumerate(joints):
        assert above is not None  # a body with joints has a parent
        anchor = tree.numbers(joint, "pos", childclass, 3)
        at_anchor = np.eye(4)
        at_anchor[:3, 3] = 0.0 if anchor is None else anchor
        link = name if k + 1 == len(joints) else f"{name}_{k}"
        origin = placement @ at_anchor if k == 0 else np.linalg.inv(link_in_body) @ at_anchor
        model.joints.append(_joint(model, joint, (above, link), origin, childclass))
        if link != name:
            model.links.append(UrdfLink(link, 0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3)))))
        link_in_body, above = at_anchor, link
    if not joints and parent is not None:
        model.joints.append(_fixed(model, name, parent, placement))
    body_in_link: Array = np.asarray(np.linalg.inv(link_in_body), dtype=np.float64)
    model.links.append(_link(model, body, name, body_in_link, childclass))
    _read_children(model, body, name, body_in_link, childclass)


def _kind(model: MjcfModel, joint: Any, childclass: str) -> str:
    return model.tree.get(joint, "type", childclass) or "hinge"


def _joint(model: MjcfModel, joint: Any, links: tuple[str, str], origin: Array, childclass: str) -> UrdfJoint:
    """Joint of a hinge or slide between two links."""
    tree, kind = model.tree, _kind(model, joint, childclass)
    name = model.name(joint, f"{links[1]}_joint")
    if kind not in ("hinge", "slide"):
        raise tree.error(joint, f"is of type {kind!r}, allowed: hinge, slide, and free at the top")

    def number(attribute: str) -> float:
        values = tree.numbers(joint, attribute, childclass)
        return 0.0 if values is None or not len(values) else float(values[0])

    hinge = kind == "hinge"
    axis = tree.numbers(joint, "axis", childclass, 3)
    axis = np.array([0.0, 0.0, 1.0]) if axis is None else axis
    if not axis.any():
        raise tree.error(joint, "its axis is zero")
    bounds = tree.numbers(joint, "range", childclass, 2)
    limited = tree.get(joint, "limited", childclass) or "auto"
    has_range = bounds is not None and (
        limited == "true" or (limited == "auto" and tree.compiler.get("autolimits", "true") == "true")
    )
    lower, upper = (-np.inf, np.inf)
    reference = number("ref")
    if has_range:
        assert bounds is not None
        # positions are relative to the pose in the file, at which MuJoCo's coordinate is ``ref``
        lower, upper = np.array(tree.angle(bounds) if hinge else bounds) - (
            tree.angle(reference) if hinge else reference
        )
    if reference:
        model.ignore("positions count from the pose in the file, not from `ref`", name)
    for attribute, what in (
        ("armature", "armature; a transmission has a motor inertia"),
        ("stiffness", "spring of a joint"),
    ):
        if number(attribute):
            model.ignore(what, name)
    force = tree.numbers(joint, "actuatorfrcrange", childclass, 2)
    joint_kind: JointKind = ("revolute" if has_range else "continuous") if hinge else "prismatic"
    return UrdfJoint(
        name=name,
        kind=joint_kind,
        parent=links[0],
        child=links[1],
        origin=frozen(origin),
        axis=frozen(axis / np.linalg.norm(axis)),
        damping=number("damping"),
        friction=number("frictionloss"),
        effort=np.inf if force is None else float(np.abs(force).max()),
        lower=float(lower),
        upper=float(upper),
    )


def _link(model: MjcfModel, body: Any, name: str, body_in_link: Array, childclass: str) -> UrdfLink:
    """Link with the mass properties and shapes of a body."""
    tree, total = model.tree, None
    shapes: dict[str, list[LinkShape]] = {"visual": [], "collision": []}
    stated = body.find("inertial")
    always = tree.compiler.get("inertiafromgeom", "auto") == "true"
    if stated is not None and not always:
        total = _stated_mass(model, stated).moved(body_in_link)
    parts = list[_Mass]()
    waiting = [(body, np.eye(4), childclass)]
    while waiting:
        element, offset, cls = waiting.pop()
        for child in element:
            if child.tag == "frame":
                inner = offset @ tree.placement(child, cls)
                waiting.append((child, inner, child.get("childclass") or cls))
            elif child.tag == "geom":
                placement = body_in_link @ offset
                if total is None:
                    parts += _geometry_mass(model, child, placement, cls)
                _add_shapes(model, child, name, placement, shapes, cls)
    total = total or _sum(parts)
    for key, geometries in shapes.items():
        shapes[key] = [_readable(model, shape, name, total) for shape in geometries]
    return UrdfLink(
        name,
        total.mass,
        frozen(total.com),
        frozen((total.inertia + total.inertia.T) / 2),
        tuple(shapes["visual"]),
        tuple(shapes["collision"]),
    )


def _stated_mass(model: MjcfModel, inertial: Any) -> _Mass:
    tree = model.tree
    mass = tree.numbers(inertial, "mass", "main", 1)
    full, diagonal = (tree.numbers(inertial, f"{kind}inertia", "main") for kind in ("full", "diag"))
    if mass is None or (full is None and diagonal is None) or mass[0] < 0:
        raise tree.error(inertial, "needs a mass that is not negative, and diaginertia or fullinertia")
    placement = tree.placement(inertial, "main")
    if full is not None:
        if len(full) != 6:
            raise tree.error(inertial, "fullinertia has to have six numbers")
        xx, yy, zz, xy, xz, yz = full
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        assert diagonal is not None
        tensor = np.diag(diagonal)
    return _Mass(float(mass[0]), np.zeros(3), tensor).moved(placement)


def _sum(parts: list[_Mass]) -> _Mass:
    """Total mass properties of several parts, by the parallel-axis theorem."""
    mass = sum(part.mass for part in parts)
    if not mass:
        return _Mass(0.0, np.zeros(3), np.zeros((3, 3)))
    com = np.sum([part.mass * part.com for part in parts], axis=0) / mass
    tensor = np.zeros((3, 3))
    for part in parts:
        arm = part.com - com
        tensor += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _Mass(float(mass), com, tensor)


def _form(model: MjcfModel, geom: Any, childclass: str) -> tuple[str, Array, Array]:
    """Kind, size and placement (4, 4) of a geometry in its body, with ``fromto`` converted."""
    tree = model.tree
    default = "mesh" if tree.get(geom, "mesh", childclass) else "sphere"
    kind = tree.get(geom, "type", childclass) or default
    size = tree.numbers(geom, "size", childclass)
    size = np.zeros(0) if size is None else size
    ends = tree.numbers(geom, "fromto", childclass, 6)
    if ends is None:
        placement = tree.placement(geom, childclass)
    else:
        along = ends[3:] - ends[:3]
        length = float(np.linalg.norm(along))
        if length < 1e-10:
            raise tree.error(geom, "fromto has no length")
        placement = np.eye(4)
        # MuJoCo turns z to the direction from the second end to the first
        placement[:3, :3], placement[:3, 3] = rotation_to(-along / length), (ends[:3] + ends[3:]) / 2
        halves = [length / 2]
        size = np.array([*size[:1], *halves]) if kind != "box" else np.array([size[0], size[0], *halves])
    counts = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
    if kind in counts and len(size) < counts[kind]:
        raise tree.error(geom, f"a {kind} needs {counts[kind]} numbers as its size")
    return kind, size, placement


def _geometry_mass(model: MjcfModel, geom: Any, offset: Array, childclass: str) -> list[_Mass]:
    """Mass properties of a uniform geometry in the link's frame; empty if it has no mass.

    A capsule has radius r and half length h. The centres of its two hemispheres, of total mass m_b, are 3 r /
    8 beyond the cylinder's ends. About an axis across, the inertia of both is therefore
    m_b ((2/5 - 9/64) r^2 + (h + 3 r / 8)^2) = m_b (2/5 r^2 + h^2 + 3/4 h r).
    """
    tree = model.tree
    kind, size, placement = _form(model, geom, childclass)
    stated, dense = (tree.numbers(geom, key, childclass, 1) for key in ("mass", "density"))
    density = DENSITY if dense is None else float(dense[0])
    if (stated is not None and not stated[0]) or (stated is None and not density) or kind == "plane":
        return []
    if kind in ("mesh", "sdf", "hfield"):
        raise tree.error(geom, f"gives its body the inertia of a {kind}; state <inertial> of the body")
    if kind == "box":
        a, b, c = size[:3]
        volume = 8 * a * b * c
        moments = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 3
    elif kind == "ellipsoid":
        a, b, c = size[:3]
        volume = 4 / 3 * np.pi * a * b * c
        moments = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 5
    elif kind == "sphere":
        volume, moments = 4 / 3 * np.pi * size[0] ** 3, np.full(3, 0.4 * size[0] ** 2)
    else:
        r, h = size[:2]
        rod, ball = 2 * np.pi * r * r * h, 4 / 3 * np.pi * r**3 if kind == "capsule" else 0.0
        volume = rod + ball
        across = rod * (r * r / 4 + h * h / 3) + ball * (0.4 * r * r + h * h + 0.75 * h * r)
        moments = np.array([across, across, rod * r * r / 2 + ball * 0.4 * r * r]) / volume
    mass = float(density * volume if stated is None else stated[0])
    return [_Mass(mass, np.zeros(3), np.diag(mass * moments)).moved(offset @ placement)]


def _add_shapes(
    model: MjcfModel, geom: Any, link: str, offset: Array, shapes: dict[str, list[LinkShape]], childclass: str
) -> None:
    """Add a geometry to the visual or collision shapes, or both; without contact masks it is visual only."""
    tree = model.tree
    kind, size, placement = _form(model, geom, childclass)
    place = frozen(offset @ placement)
    masks = [tree.numbers(geom, key, childclass, 1) for key in ("contype", "conaffinity")]
    touches = any(mask is None or mask[0] for mask in masks)
    rgba = tree.numbers(geom, "rgba", childclass, 4)
    material = tree.get(geom, "material", childclass) or ""
    element = next((m for m in tree.root.iterfind("asset/material") if m.get("name") == material), None)
    if rgba is None and element is not None:
        rgba = tree.numbers(element, "rgba", "main", 4)
    forms: list[tuple[Geometry, float]] = []
    if kind == "box":
        forms.append((Geometry("box", frozen(2 * size[:3])), 0.0))
    elif kind == "sphere":
        forms.append((Geometry("sphere", frozen(size[:1])), 0.0))
    elif kind in ("cylinder", "capsule"):
        forms.append((Geometry("cylinder", frozen([size[0], 2 * size[1]])), 0.0))
        ball = Geometry("sphere", frozen(size[:1]))
        forms += [(ball, size[1]), (ball, -size[1])] if kind == "capsule" else []
    elif kind == "mesh":
        forms.append((_mesh(model, geom, childclass), 0.0))
    else:
        model.ignore(f"geometry of type {kind}", link)
    for geometry, along in forms:
        at = place.copy()
        at[:3, 3] += along * place[:3, 2]
        colour = None if rgba is None else frozen(np.clip(rgba, 0, 1))
        shape = LinkShape(geom.get("name"), frozen(at), geometry, colour, material)
        group = tree.numbers(geom, "group", childclass, 1)
        if touches:
            shapes["collision"].append(shape)
        # MuJoCo's viewer hides groups 3 and above, which models use for pure collision shapes
        if not touches or group is None or group[0] < 3:
            shapes["visual"].append(shape)


def _mesh(model: MjcfModel, geom: Any, childclass: str) -> Geometry:
    """Mesh of a geometry, with the file of its asset."""
    tree, name = model.tree, model.tree.get(geom, "mesh", childclass)
    for asset in tree.root.iterfind("asset/mesh"):
        file = asset.get("file")
        if file is None or (asset.get("name") or Path(file).stem) != name:
            continue
        folder = tree.compiler.get("meshdir") or tree.compiler.get("assetdir") or ""
        scale = tree.numbers(asset, "scale", "main", 3)
        path = (tree.path.parent / folder / file).resolve()
        return Geometry("mesh", frozen(np.ones(3) if scale is None else scale), path)
    return Geometry("mesh", frozen(np.ones(3)), Path(str(name)))


def _readable(model: MjcfModel, shape: LinkShape, link: str, mass: _Mass) -> LinkShape:
    """The shape itself, or a box if its mesh is missing."""
    path = shape.geometry.mesh
    if path is None or (path.is_file() and is_readable(shape.geometry)):
        return shape
    fault = "cannot be read" if path.is_file() else "not found"
    model.missing.setdefault((path.name, fault), []).append(link)
    return stand_in(mass.mass, mass.com, mass.inertia)


def _read_equalities(model: MjcfModel) -> None:
    """Convert linear joint constraints to mimic joints, and record other constraints as ignored."""
    by_name = {joint.name: k for k, joint in enumerate(model.joints)}
    for constraint in model.tree.root.iterfind("equality/*"):
        first, second = constraint.get("joint1"), constraint.get("joint2")
        polynomial = model.tree.numbers(constraint, "polycoef", "main")
        polynomial = np.array([0.0, 1.0]) if polynomial is None else polynomial
        linear = constraint.tag == "joint" and not polynomial[2:].any() and len(polynomial) > 1
        if not linear or first not in by_name or second not in by_name:
            model.ignore("constraint without a counterpart", f"{constraint.tag} {first or ''}".strip())
            continue
        joint = model.joints[by_name[first]]
        mimic = Mimic(second, float(polynomial[1]), float(polynomial[0]))
        model.joints[by_name[first]] = UrdfJoint(**{**vars(joint), "mimic": mimic})


def _read_actuators(model: MjcfModel) -> None:
    """Set the effort limits of joints to the force limits of their actuators times the gear [N or N m]."""
    by_name, tree = {joint.name: k for k, joint in enumerate(model.joints)}, model.tree
    for actuator in tree.root.iterfind("actuator/*"):
        name = actuator.get("joint")
        label = actuator.get("name") or f"<{actuator.tag}>"
        if name not in by_name or actuator.tag not in ACTUATORS:
            model.ignore("actuator of no joint", label)
            continue
        gear = tree.numbers(actuator, "gear", "main")
        ratio = 1.0 if gear is None else abs(float(gear[0]))
        bounds = tree.numbers(actuator, "forcerange", "main", 2)
        if bounds is None and actuator.tag == "motor":
            bounds = tree.numbers(actuator, "ctrlrange", "main", 2)
        if actuator.tag != "motor":
            model.ignore("gains of an actuator; a controller of the scenario has them", label)
        if bounds is not None:
            joint = model.joints[by_name[name]]
            effort = min(joint.effort, ratio * float(np.abs(bounds).max()))
            model.joints[by_name[name]] = UrdfJoint(**{**vars(joint), "effort": effort})
