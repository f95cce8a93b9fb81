"""Fill a scenario's document with what its URDFs say, so that every number has a dotted path."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spacerobot.description.find import find_urdf
from spacerobot.description.read import Description, read_description
from spacerobot.errors import DescriptionError, ScenarioError, near_names
from spacerobot.scenario.paths import Document

NO_LIMIT = 1e300
"""Effort limits above this stand for none (URDF readers use the greatest float)."""


def body_documents(document: Document) -> dict[str, Document]:
    """Sub-documents of robots and target by their dotted path."""
    bodies = {f"robots.{name}": robot for name, robot in document["robots"].items()}
    if document.get("target") is not None:
        bodies["target"] = document["target"]
    return bodies


def read_descriptions(document: Document, *, source: Path | None) -> dict[str, Description]:
    """URDF of each body, by the body's dotted path.

    Raises
    ------
    DescriptionError
        If a URDF is not found, not readable or cannot be simulated.
    """
    folder = source.parent if source is not None else None
    known: dict[Path, Description] = {}
    descriptions = {}
    for path, body in body_documents(document).items():
        try:
            file = find_urdf(body["urdf"], folder)
        except DescriptionError as fault:
            raise ScenarioError(str(fault), source=source, where=f"{path}.urdf") from None
        if file not in known:
            known[file] = read_description(file)
        descriptions[path] = known[file]
    return descriptions


def fill(document: Document, descriptions: Mapping[str, Description], *, source: Path | None) -> Document:
    """Document with every link's mass properties and every joint's state and resistance.

    What the document already says wins over the URDF.

    Raises
    ------
    ScenarioError
        If the document names a link or joint that the URDF does not have, or gives an angle to a
        prismatic joint (or an offset to a revolute one).
    """
    filled = dict(document)
    filled["robots"] = dict(document["robots"])
    for path, body in body_documents(document).items():
        new = dict(body)
        new["links"] = _links(body["links"], descriptions[path], path=path, source=source)
        new["joints"] = _joints(body["joints"], descriptions[path], path=path, source=source)
        if path == "target":
            filled["target"] = new
        else:
            filled["robots"][path.removeprefix("robots.")] = new
    return filled


def _links(given: Document, description: Description, *, path: str, source: Path | None) -> Document:
    names = [link.name for link in description.links]
    _refuse_unknown(given, names, f"{path}.links", "link", source)
    filled = {}
    for link in description.links:
        own = {key: value for key, value in (given.get(link.name) or {}).items() if value is not None}
        if link.mass == 0 and not own:
            continue
        inertia = link.inertia
        from_urdf: Document = {
            "mass": float(link.mass),
            "com": [float(x) for x in link.com],
            "inertia": [float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))],
        }
        filled[link.name] = from_urdf | own
    return filled


def _joints(given: Document, description: Description, *, path: str, source: Path | None) -> Document:
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    _refuse_unknown(given, [joint.name for joint in moving], f"{path}.joints", "moving joint", source)
    filled = {}
    for joint in moving:
        own = {key: value for key, value in (given.get(joint.name) or {}).items() if value is not None}
        prismatic = joint.kind == "prismatic"
        for key in ("angle_deg", "rate_deg") if prismatic else ("offset", "speed"):
            if key in own:
                right = "offset and speed" if prismatic else "angle_deg and rate_deg"
                raise ScenarioError(
                    f"not for a {joint.kind} joint; use {right}",
                    source=source,
                    where=f"{path}.joints.{joint.name}.{key}",
                )
        from_urdf: Document = (
            {"offset": 0.0, "speed": 0.0} if prismatic else {"angle_deg": 0.0, "rate_deg": 0.0}
        )
        from_urdf["damping"] = float(joint.damping)
        if 0 < joint.effort < NO_LIMIT:
            from_urdf["torque_limit"] = float(joint.effort)
        filled[joint.name] = from_urdf | own
    return filled


def _refuse_unknown(given: Any, names: list[str], where: str, what: str, source: Path | None) -> None:
    for name in given:
        if name not in names:
            raise ScenarioError(
                f"no {what} {name!r} in the URDF; {near_names(name, names)}", source=source, where=where
            )
