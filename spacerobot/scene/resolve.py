"""Completion of a scenario's document with values of its URDFs, so that every number has a dotted path.

Pinocchio is imported only for the rotations of mounted and placed links, so that a wrong file, joint or value
is reported at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError, ScenarioError, near_names
from spacerobot.common.section import matching
from spacerobot.description.find import find_urdf, is_file
from spacerobot.description.mount import mounted
from spacerobot.description.parts import UrdfJoint as UrdfJoint
from spacerobot.description.read import Description, read_description
from spacerobot.description.relocated_links import placed
from spacerobot.description.xacro import SUFFIX, expand_xacro
from spacerobot.elements import FAMILIES, Element, create
from spacerobot.elements.core.registry import find_kind
from spacerobot.scenario import Joint, Scenario
from spacerobot.scenario.load import apply_changes, to_document, validate
from spacerobot.scenario.paths import Document

_STATES = ("angle_deg", "rate_deg", "offset", "speed")
NO_LIMIT = 1e300
"""Effort limits above this mean no limit (URDF readers use the largest float)."""


def resolve(
    scenario: Scenario,
    changes: Mapping[str, Any] | Sequence[tuple[str, Any]],
    *,
    source: Path | None,
    expand_xacro: bool = False,
) -> tuple[Scenario, Mapping[str, Description]]:
    """Scenario with URDF values and changes applied, and the URDFs with locked joints, by body path.

    Raises:
        ScenarioError, DescriptionError: If a change names no value or the result is invalid.
    """
    pairs = list(changes.items()) if isinstance(changes, Mapping) else list(changes)
    document = to_document(scenario)
    naming_files = [(pattern, value) for pattern, value in pairs if _names_files(pattern, value)]
    if naming_files:
        document = forget_files(apply_changes(document, naming_files, source=source), document)
    locate(document, source=source)
    read_files(document, source=source)
    expand_files(document, source=source, allowed=expand_xacro)
    descriptions = read_descriptions(document, source=source)
    document = fill(document, descriptions, source=source)
    others = list[tuple[str, Any]]()
    for pattern, value in pairs:
        if _names_files(pattern, value):
            continue
        others.append((pattern, value))
        # the inertia of links that a change sets is not scaled by their mass
        link, separator, tail = pattern.rpartition(".inertia")
        if separator and ".links." in link and (not tail or tail[1:] == "*" or tail[1:].isdecimal()):
            others.append((f"{link}.inertia_at_mass", None))
    if others:
        document = apply_changes(document, others, source=source)
        read_files(document, source=source)
        if any("placements" in pattern.split(".")[1:3] for pattern, _ in others):
            descriptions = read_descriptions(document, source=source)
        # once more, for sections that a change replaced, and names that it brought in
        document = fill(document, descriptions, source=source)
    resolved = validate(document, source=source)
    return resolved, settle(resolved, descriptions, source=source)


def _names_files(pattern: str, value: Any) -> bool:
    """Whether a change affects which files are read or which links exist, as replacing a whole body does."""
    segments = pattern.split(".")
    is_body = isinstance(value, Mapping) and (segments == ["target"] or segments[:-1] == ["robots"])
    added = "mounts" in segments[2:3] or "flexible" in segments[1:3]
    return is_body or added or segments[-1] in ("urdf", "file")


def body_documents(document: Document) -> dict[str, Document]:
    """Sub-documents of robots and target by their dotted path."""
    bodies = {f"robots.{name}": robot for name, robot in document["robots"].items()}
    if document.get("target") is not None:
        bodies["target"] = document["target"]
    return bodies


def locate(document: Document, *, source: Path | None) -> None:
    """Name every URDF by its absolute path, in place; a shipped one by its file's name.

    Raises:
        ScenarioError: If one is not found.
    """
    folder = source.parent if source is not None else None
    for path, section in _with_urdfs(document).items():
        file = _found(path, section, source)
        shipped = section["urdf"] == file.name and not (folder is not None and (folder / file.name).is_file())
        section["urdf"] = file.name if shipped else str(file)


def _found(path: str, section: Document, source: Path | None) -> Path:
    """File of the URDF that a section at a dotted path names."""
    try:
        return find_urdf(section["urdf"], source.parent if source is not None else None)
    except DescriptionError as fault:
        raise ScenarioError(str(fault), source=source, where=f"{path}.urdf") from None


def _with_urdfs(document: Document) -> dict[str, Document]:
    """Sections that name a URDF, by dotted path: bodies, each followed by the parts mounted on it."""
    sections: dict[str, Document] = {}
    for path, body in body_documents(document).items():
        sections[path] = body
        sections |= {f"{path}.mounts.{name}": mount for name, mount in body.get("mounts", {}).items()}
    return sections


def read_files(document: Document, *, source: Path | None) -> None:
    """Fill in, in place, the content of elements' files such as plans; existing values stay.

    Raises:
        ScenarioError: If a file is outside the scenario's folder, does not exist, or has the wrong format.
    """
    for where, section, kind in _reading(document):
        if section.get("file") is None or section.get(str(kind.fills)) is not None:
            continue
        try:
            # file that a scenario names, in the scenario's folder
            name = section["file"]
            if source is None:
                raise ScenarioError(
                    f"found {name!r}, but there is no scenario file in whose folder it could be"
                )
            folder = source.resolve().parent
            try:
                file = (folder / name).resolve()
            except (OSError, ValueError, RuntimeError):
                raise ScenarioError(f"found {name!r}, which is no path") from None
            if not file.is_relative_to(folder):
                raise ScenarioError(
                    f"found {name!r}, which leads out of the scenario's folder; put it into that"
                )
            if not is_file(file):
                raise ScenarioError(f"no such file: {name!r} in the scenario's folder")
            section[str(kind.fills)] = kind.read(file, where, section.get("phase"))
        except ScenarioError as fault:
            message = (
                f"{fault.source.name}: {fault.message}" if isinstance(fault.source, Path) else fault.message
            )
            raise ScenarioError(message, source=source, where=f"{where}.file") from None


def forget_files(document: Document, before: Document) -> Document:
    """Document without content of files where it names other files than before."""
    urdfs = {where: section.get("urdf") for where, section in _sections(before)}
    for where, section in _sections(document):
        if section.get("expanded_urdf") is not None and section.get("urdf") != urdfs.get(where):
            section["expanded_urdf"] = None
    old = {where: section.get("file") for where, section, _ in _reading(before)}
    for where, section, kind in _reading(document):
        if section.get("file") is not None and where in old and section["file"] != old[where]:
            section[str(kind.fills)] = None
    return document


def _reading(document: Document) -> list[tuple[str, Document, type[Element]]]:
    """Sections of elements that read files, with their dotted paths."""
    reading = []
    for where, section in _sections(document):
        if "kind" in section and "file" in section:
            kinds = (find_kind(family, str(section["kind"])) for family in FAMILIES)
            reading += [(where, section, kind) for kind in kinds if kind is not None and kind.fills][:1]
    return reading


def _sections(node: Any, path: str = "") -> Iterator[tuple[str, Document]]:
    """Mappings in a document with their dotted paths."""
    if isinstance(node, dict):
        yield path, node
        for key, value in node.items():
            yield from _sections(value, f"{path}.{key}" if path else str(key))


def expand_files(document: Document, *, source: Path | None, allowed: bool) -> None:
    """Fill in, in place, the expanded URDF text of xacro files; existing text stays.

    Raises:
        DescriptionError: If a file cannot be expanded.
        ScenarioError: If a file must be expanded and that is not allowed, as in a result.
    """
    for path, section in _with_urdfs(document).items():
        if Path(section["urdf"]).suffix != SUFFIX:
            section["expanded_urdf"] = None
        elif section.get("expanded_urdf") is None:
            if not allowed:
                raise ScenarioError(
                    f"found {section['urdf']!r}, a xacro program, which is expanded for a scenario "
                    "of your own only, not for a result; run the scenario again, or give `expand_xacro=True`",
                    source=source,
                    where=f"{path}.urdf",
                )
            section["expanded_urdf"] = expand_xacro(_found(path, section, source))


def read_descriptions(document: Document, *, source: Path | None) -> dict[str, Description]:
    """URDF of each body by dotted path, with mounted parts, placed links and expanded flexible links.

    Raises:
        DescriptionError: If a URDF is not readable or cannot be simulated.
        ScenarioError: If a file is not found, or a part cannot be mounted.
    """
    files = {
        path: (_found(path, section, source), section.get("expanded_urdf"))
        for path, section in _with_urdfs(document).items()
    }
    descriptions_by_file = {file: read_description(*file) for file in dict.fromkeys(files.values())}
    descriptions = {}
    for path, body in body_documents(document).items():
        description = descriptions_by_file[files[path]]
        for name, mount in body.get("mounts", {}).items():
            where = f"{path}.mounts.{name}"
            arm, mounting = descriptions_by_file[files[where]], np.eye(4)
            mounting[:3, :3] = _rotation(mount["rotation_deg"])
            mounting[:3, 3] = mount["position"]
            try:
                description = mounted(description, arm, name, mount["link"], mounting)
            except DescriptionError as fault:
                raise ScenarioError(fault.message, source=source, where=where) from None
        # links where the scenario places them; values equal to the URDF's keep the exact numbers
        origins = {}
        joints = {joint.child: joint.origin for joint in description.joints}
        for link, placement in body["placements"].items():
            joint_origin = joints.get(link, np.eye(4))
            origin, was, described = np.array(joint_origin), _placement(joint_origin), placement or {}
            if described.get("position") not in (None, was["position"]):
                origin[:3, 3] = described["position"]
            if described.get("rotation_deg") not in (None, was["rotation_deg"]):
                origin[:3, :3] = _rotation(described["rotation_deg"])
            origins[link] = origin
        try:
            description = placed(description, origins) if origins else description
        except DescriptionError as fault:
            raise ScenarioError(fault.message, source=source, where=f"{path}.placements") from None
        for name, section in body.get("flexible", {}).items():
            try:
                description = create("flexible_link", **section).expanded(description, name)
            except DescriptionError as fault:
                where = f"{path}.flexible.{name}" + (f".{fault.where}" if fault.where else "")
                raise ScenarioError(fault.message, source=source, where=where) from None
        descriptions[path] = description
    return descriptions


def _rotation(angles_deg: Sequence[float]) -> Array:
    """Rotation matrix (3, 3) of roll, pitch and yaw [deg]."""
    import pinocchio as pin

    return np.array(pin.rpy.rpyToMatrix(np.radians(angles_deg)))


def _placement(origin: Array) -> Document:
    """Section of the scenario for a placement (4, 4): position [m], and roll, pitch, yaw [deg]."""
    import pinocchio as pin

    rotation = np.degrees(pin.rpy.matrixToRpy(np.array(origin[:3, :3])))
    return {"position": origin[:3, 3].tolist(), "rotation_deg": (rotation + 0.0).tolist()}


def fill(document: Document, descriptions: Mapping[str, Description], *, source: Path | None) -> Document:
    """Document with every link's mass properties and every joint's state and resistance.

    Values in the document take precedence over the URDF.

    Raises:
        ScenarioError: If the document names an unknown link or joint, or gives an angle to a prismatic joint,
            an offset to a revolute one, or either to a mimic joint.
    """
    filled = dict(document)
    filled["robots"] = dict(document["robots"])
    for path, body in body_documents(document).items():
        new, description = dict(body), descriptions[path]
        names = [link.name for link in description.links]
        sections = _by_name(body["links"], names, f"{path}.links", "link", source)
        new["links"] = {}
        for link in description.links:
            section = sections.get(link.name, {})
            if link.mass == 0 and not link.inertia.any() and not section:
                continue
            inertia = link.inertia
            from_urdf: Document = {"mass": float(link.mass), "com": [float(x) for x in link.com]}
            if "inertia" not in section:
                places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
                from_urdf["inertia"] = [float(inertia[i, j]) for i, j in places]
                if link.mass > 0 and inertia.any():
                    from_urdf["inertia_at_mass"] = float(link.mass)
            link_section = from_urdf | section
            # an inertia stated for another mass is scaled to the link's mass
            mass, belongs = link_section["mass"], link_section.get("inertia_at_mass")
            if belongs is not None and belongs != mass:
                link_section["inertia"] = [value * (mass / belongs) for value in link_section["inertia"]]
                link_section["inertia_at_mass"] = mass or None
            new["links"][link.name] = link_section
        origins = {joint.child: joint.origin for joint in description.joints}
        new["placements"] = {
            link: _placement(origins[link]) | {k: v for k, v in (section or {}).items() if v is not None}
            for link, section in body["placements"].items()
        }
        moving = [joint for joint in description.joints if joint.kind != "fixed"]
        names = [joint.name for joint in moving]
        sections = _by_name(body["joints"], names, f"{path}.joints", "moving joint", source)
        new["joints"] = {}
        for joint in moving:
            section = sections.get(joint.name, {})
            state = ("offset", "speed") if joint.kind == "prismatic" else ("angle_deg", "rate_deg")
            follows = joint.mimic is not None and not section.get("locked")
            for key in [key for key in (*_STATES, "torque_limit") if key in section]:
                if follows or (key in _STATES and key not in state):
                    where = f"{path}.joints.{joint.name}.{key}"
                    why = f"not for a {joint.kind} joint; use {' and '.join(state)}"
                    if follows and joint.mimic is not None:
                        why = f"this joint mimics {joint.mimic.joint!r}; give that one's, or `locked: true`"
                    raise ScenarioError(why, source=source, where=where)
            from_urdf = {} if joint.mimic is not None else dict.fromkeys(state, 0.0)
            from_urdf["damping"] = float(joint.damping)
            if 0 < joint.effort < NO_LIMIT and joint.mimic is None:
                from_urdf["torque_limit"] = float(joint.effort)
            new["joints"][joint.name] = from_urdf | section
        if path == "target":
            filled["target"] = new
        else:
            filled["robots"][path.removeprefix("robots.")] = new
    return filled


def _by_name(
    sections_by_pattern: Document, names: Sequence[str], where: str, noun: str, source: Path | None
) -> dict[str, Document]:
    """Sections by name with patterns expanded: later patterns win, and full names always win."""
    sections: dict[str, Document] = {}
    for pattern in sorted(sections_by_pattern, key=lambda name: "*" not in name):  # stable: full names last
        matched = matching(names, pattern) if "*" in pattern else [name for name in names if name == pattern]
        if not matched:
            hint = near_names(pattern, names)
            raise ScenarioError(f"no {noun} {pattern!r} in the URDF; {hint}", source=source, where=where)
        section = {
            key: value for key, value in (sections_by_pattern[pattern] or {}).items() if value is not None
        }
        for name in matched:
            sections[name] = sections.get(name, {}) | section
    return sections


def settle(
    scenario: Scenario, descriptions: Mapping[str, Description], *, source: Path | None
) -> dict[str, Description]:
    """URDF of each body with the scenario's joints locked, and mimic joints resolved.

    Raises:
        ScenarioError: If a joint that is not locked mimics an unsuitable joint.
    """
    settled = {}
    for path, description in descriptions.items():
        body = scenario.target if path == "target" else scenario.robots[path.removeprefix("robots.")]
        joints = {} if body is None else body.joints
        begins = {name: begin for name, joint in joints.items() if (begin := position(joint)) is not None}
        try:
            settled[path] = description.settled(begins, [name for name in joints if joints[name].locked])
        except DescriptionError as fault:
            raise ScenarioError(str(fault), source=source, where=f"{path}.joints") from None
    return settled


def position(joint: Joint) -> float | None:
    """Initial position of a joint [rad or m]; None if the scenario does not give it."""
    if joint.angle_deg is not None:
        return float(np.radians(joint.angle_deg))
    return joint.offset
