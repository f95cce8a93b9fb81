"""Syntax checks of URDF: a safe XML tree, with elements and attributes of the right number and type."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import get_args

from lxml import etree

from spacerobot.common.errors import DescriptionError
from spacerobot.description.parts import JointKind

LARGEST = 1e12
"""Maximum length, mass and inertia [SI units]; larger ones are errors."""
_LARGEST_LIMIT = 1.7976931348623157e308  # files use very large limits for unlimited joints
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_SHAPES: dict[str, dict[str, int]] = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {},
}
_OTHERS = {"link", "joint", "material", "gazebo", "transmission", "sensor", "drake", "mujoco", "version"}


def parse_xml(data: bytes, source: Path) -> etree._Element:
    """Root element of XML data, parsed without external entities, network access or error recovery.

    Raises:
        DescriptionError: If the data is not well-formed XML, or declares a document type, which may define
            entities.
    """
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, LookupError, ValueError) as error:
        reason = error.msg if isinstance(error, etree.XMLSyntaxError) else str(error)
        raise DescriptionError(f"no well-formed XML: {reason}", source=source) from error
    if root.getroottree().docinfo.doctype:
        raise DescriptionError("declares a document type, which a URDF may not", source=source)
    return root


def check_syntax(root: etree._Element, source: Path) -> list[str]:
    """Check the number of elements and the types of their attributes.

    Returns:
        list[str]: Warnings about unknown top-level elements.

    Raises:
        DescriptionError: If a check fails; the message has the file and the element.
    """
    _Checker(source).robot(root)
    unknown = sorted({str(child.tag) for child in root if child.tag not in _OTHERS})
    return [f"unknown element <{tag}> ignored" for tag in unknown]


class _Checker:
    """Checks of a URDF tree; ``source`` is the file for error messages."""

    def __init__(self, source: Path) -> None:
        self._source = source

    def robot(self, root: etree._Element) -> None:
        """Check the complete tree; see :func:`check_syntax`."""
        if root.tag != "robot":
            raise self._error(root, "is the outermost element; it has to be <robot>")
        self._text(root, "name")
        for kind, check in (("link", self._link), ("joint", self._joint), ("material", self._material)):
            names: set[str] = set()
            for element in root.findall(kind):
                name = self._text(element, "name")
                if name in names:
                    raise self._error(element, f"is the second {kind} of this name")
                names.add(name)
                check(element)

    def _link(self, link: etree._Element) -> None:
        for inertial in self._at_most_one(link, "inertial"):
            self._origin(inertial)
            mass = self._one(inertial, "mass")
            self._numbers(mass, "value", 1, low=0)
            for inertia in self._at_most_one(inertial, "inertia"):
                for attribute in ("ixx", "iyy", "izz"):
                    self._numbers(inertia, attribute, 1)
                for attribute in ("ixy", "ixz", "iyz"):
                    self._numbers(inertia, attribute, 1, needed=False)
        for shape in (*link.findall("visual"), *link.findall("collision")):
            self._origin(shape)
            geometry = self._one(shape, "geometry")
            if len(geometry) != 1 or geometry[0].tag not in _SHAPES:
                tags = ", ".join(f"<{child.tag}>" for child in geometry) or "nothing"
                raise self._error(geometry, f"holds {tags}; allowed is one of {', '.join(_SHAPES)}")
            form = geometry[0]
            for attribute, count in _SHAPES[str(form.tag)].items():
                self._numbers(form, attribute, count, low=0)
            if form.tag == "mesh":
                self._text(form, "filename")
                scale = form.get("scale", "1").split()
                self._numbers(form, "scale", 1 if len(scale) == 1 else 3, needed=False)
            for material in self._at_most_one(shape, "material"):
                self._material(material)

    def _material(self, material: etree._Element) -> None:
        for colour in self._at_most_one(material, "color"):
            self._numbers(colour, "rgba", 4, low=0)

    def _joint(self, joint: etree._Element) -> None:
        kind = self._text(joint, "type")
        if kind not in get_args(JointKind):
            allowed = ", ".join(get_args(JointKind))
            raise self._error(joint, f"is of type {_shorten(kind)!r}, allowed: {allowed}")
        for end in ("parent", "child"):
            self._text(self._one(joint, end), "link")
        self._origin(joint)
        for axis in self._at_most_one(joint, "axis"):
            self._numbers(axis, "xyz", 3)
        for mimic in self._at_most_one(joint, "mimic"):
            self._text(mimic, "joint")
            for attribute in ("multiplier", "offset"):
                self._numbers(mimic, attribute, 1, needed=False)
        bounded = kind in ("revolute", "prismatic")
        for limit in self._at_most_one(joint, "limit", needed=bounded):
            for attribute in ("effort", "velocity"):
                self._numbers(limit, attribute, 1, low=0, high=_LARGEST_LIMIT)
            for attribute in ("lower", "upper"):
                self._numbers(limit, attribute, 1, needed=False, low=-_LARGEST_LIMIT, high=_LARGEST_LIMIT)
        for dynamics in self._at_most_one(joint, "dynamics"):
            for attribute in ("damping", "friction"):
                self._numbers(dynamics, attribute, 1, needed=False, low=0)

    def _origin(self, parent: etree._Element) -> None:
        for origin in self._at_most_one(parent, "origin"):
            for attribute in ("xyz", "rpy"):
                self._numbers(origin, attribute, 3, needed=False)

    def _at_most_one(self, parent: etree._Element, tag: str, *, needed: bool = False) -> list[etree._Element]:
        children: list[etree._Element] = parent.findall(tag)
        if len(children) > 1 or (needed and not children):
            allowed = "one is needed" if needed else "at most one is allowed"
            raise self._error(parent, f"holds {len(children)} <{tag}> elements, {allowed}")
        return children

    def _one(self, parent: etree._Element, tag: str) -> etree._Element:
        return self._at_most_one(parent, tag, needed=True)[0]

    def _text(self, element: etree._Element, attribute: str) -> str:
        value: str | None = element.get(attribute)
        if value is None or not value.strip():
            raise self._error(element, f"has no {attribute!r}")
        return value

    def _numbers(
        self,
        element: etree._Element,
        attribute: str,
        count: int,
        *,
        needed: bool = True,
        low: float = -LARGEST,
        high: float = LARGEST,
    ) -> None:
        """Check that an attribute has ``count`` finite numbers in a range."""
        text = element.get(attribute)
        if text is None and not needed:
            return
        if text is None:
            raise self._error(element, f"has no {attribute!r}")
        words = text.split()
        good = [word for word in words if _NUMBER.fullmatch(word) and math.isfinite(float(word))]
        if len(good) != len(words) or len(words) != count:
            noun = "one finite number" if count == 1 else f"{count} finite numbers"
            raise self._error(element, f"found {attribute}={_shorten(text)!r}, allowed: {noun}")
        for word in words:
            if not low <= float(word) <= high:
                raise self._error(
                    element, f"found {attribute}={_shorten(text)!r}, allowed: {low:g} to {high:g}"
                )

    def _error(self, element: etree._Element, message: str) -> DescriptionError:
        """Error at an element, with the link or joint that contains it and its line."""
        where = []
        for ancestor in reversed([element, *element.iterancestors()]):
            name = ancestor.get("name")
            if ancestor is element or (name and ancestor.tag in ("link", "joint")):
                tag = str(ancestor.tag)
                if ancestor.prefix and "}" in tag:
                    tag = f"{ancestor.prefix}:{tag.partition('}')[2]}"
                where.append(f"{tag} {_shorten(name)!r}" if name else f"<{tag}>")
        where.append(f"(line {element.sourceline})")
        return DescriptionError(message, source=self._source, where=" ".join(where))


def _shorten(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."
