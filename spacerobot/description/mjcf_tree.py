"""XML tree of an MJCF file with its defaults; only files that it includes are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.description.syntax import LARGEST, parse_xml

MOST_INCLUDES = 100
MOST_BYTES = 20_000_000
ACTUATORS = (
    "general",
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
)
"""Kinds of actuators, which share their defaults."""


@dataclass(frozen=True, eq=False)
class MjcfTree:
    """Elements of a model, with attributes from defaults.

    Attributes:
        root: Element ``<mujoco>`` with the content of included files.
        path: Main file.
        data: Bytes of all files in the order of reading.
        compiler: Attributes of all ``<compiler>`` elements; later ones override.
        defaults: Default attributes by class and element.
    """

    root: Any
    path: Path
    data: bytes
    compiler: Mapping[str, str]
    defaults: Mapping[str, Mapping[str, Mapping[str, str]]] = field(default_factory=dict)

    def error(self, element: Any, message: str) -> DescriptionError:
        """Error at an element, to be raised."""
        name = element.get("name")
        where = f"{element.tag} {name!r}" if name else f"<{element.tag}>"
        return DescriptionError(message, source=self.path, where=f"{where} (line {element.sourceline})")

    def get(self, element: Any, attribute: str, childclass: str) -> str | None:
        """Attribute of an element, or its default in the element's class, or in ``childclass``; None without.

        Args:
            element: The element.
            attribute: Name of the attribute.
            childclass: Class of defaults stated by the surrounding bodies.

        Raises:
            DescriptionError: If the class does not exist.
        """
        if (value := element.get(attribute)) is not None:
            return str(value)
        name = element.get("class") or childclass
        if name not in self.defaults:
            raise self.error(element, f"class {name!r} does not exist; allowed: {', '.join(self.defaults)}")
        tag = "actuator" if element.tag in ACTUATORS else str(element.tag)
        return self.defaults[name].get(tag, {}).get(attribute)

    def numbers(
        self, element: Any, attribute: str, childclass: str, count: int | None = None
    ) -> Array | None:
        """Numbers of an attribute; None without the attribute.

        Args:
            element, attribute, childclass: As for :meth:`get`.
            count: Required number of numbers; any if None.

        Raises:
            DescriptionError: If a number is not finite or too large, or the count is wrong.
        """
        text = self.get(element, attribute, childclass)
        if text is None:
            return None
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            raise self.error(element, f"found {attribute}={text[:60]!r}, allowed: numbers") from None
        if (count is not None and len(values) != count) or not np.all(np.abs(values) <= LARGEST):
            allowed = f"{count} finite numbers" if count is not None else "finite numbers"
            raise self.error(element, f"found {attribute}={text[:60]!r}, allowed: {allowed}")
        return values

    @property
    def in_degrees(self) -> bool:
        """Whether angles are in degrees, MuJoCo's default."""
        return self.compiler.get("angle", "degree") == "degree"

    def angle(self, value: Any) -> Any:
        """Angle [rad] of a number in the file's unit."""
        return np.radians(value) if self.in_degrees else value

    def placement(self, element: Any, childclass: str) -> Array:
        """Placement of an element (4, 4) from ``pos`` and one of MuJoCo's five forms of orientations."""
        placement = np.eye(4)
        position = self.numbers(element, "pos", childclass, 3)
        placement[:3, 3] = 0.0 if position is None else position
        placement[:3, :3] = self._rotation(element, childclass)
        return placement

    def _rotation(self, element: Any, childclass: str) -> Array:
        def numbers(name: str, count: int) -> Array | None:
            return self.numbers(element, name, childclass, count)

        if (quaternion := numbers("quat", 4)) is not None:
            if not quaternion.any():
                raise self.error(element, "its quaternion is zero")
            return np.asarray(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix())
        if (axis_angle := numbers("axisangle", 4)) is not None:
            axis = self._unit(element, axis_angle[:3])
            return np.asarray(Rotation.from_rotvec(self.angle(axis_angle[3]) * axis).as_matrix())
        if (euler := numbers("euler", 3)) is not None:
            # lower case are intrinsic rotations in MuJoCo, upper case in SciPy
            sequence = self.compiler.get("eulerseq", "xyz").swapcase()
            return np.asarray(Rotation.from_euler(sequence, self.angle(euler)).as_matrix())
        if (axes := numbers("xyaxes", 6)) is not None:
            x = self._unit(element, axes[:3])
            y = self._unit(element, axes[3:] - x * (x @ axes[3:]))
            return np.column_stack([x, y, np.cross(x, y)])
        if (z := numbers("zaxis", 3)) is not None:
            return rotation_to(self._unit(element, z))
        return np.eye(3)

    def _unit(self, element: Any, vector: Array) -> Array:
        length = float(np.linalg.norm(vector))
        if length < 1e-10:
            raise self.error(element, "an axis is zero")
        return np.asarray(vector / length)


def rotation_to(z: Array) -> Array:
    """Rotation (3, 3) by the smallest angle from the z axis to a unit vector."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine, cosine = float(np.linalg.norm(axis)), float(z[2])
    if sine < 1e-10:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(Rotation.from_rotvec(axis / sine * math.atan2(sine, cosine)).as_matrix())


def read_tree(data: bytes, source: Path) -> MjcfTree:
    """Read the tree of a model, including its included files.

    Args:
        data: Bytes of the main file.
        source: Path of the main file.

    Raises:
        DescriptionError: If a file cannot be read or is not well-formed XML, or is included twice.
    """
    root, files = parse_xml(data, source), [data]
    sources = {source.resolve()}
    while (include := next(root.iter("include"), None)) is not None:
        name = include.get("file") or ""
        path = (source.parent / name).resolve()
        if path in sources or len(sources) > MOST_INCLUDES:
            raise DescriptionError(f"includes {name!r} twice", source=source)
        sources.add(path)
        try:
            if path.stat().st_size > MOST_BYTES:
                raise DescriptionError(f"is larger than {MOST_BYTES} bytes", source=path)
            files.append(path.read_bytes())
        except (OSError, ValueError):
            raise DescriptionError(
                f"includes {name!r}, which cannot be read", source=source, where=f"line {include.sourceline}"
            ) from None
        part, parent = parse_xml(files[-1], path), include.getparent()
        at = parent.index(include)
        parent[at : at + 1] = list(part)
    compiler: dict[str, str] = {}
    for element in root.iterfind("compiler"):
        compiler |= dict(element.attrib)
    defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
    for element in root.iterfind("default"):
        _read_defaults(element, {}, defaults, "main")
    return MjcfTree(root, source, b"".join(files), compiler, defaults)


def _read_defaults(
    element: Any, inherited: Mapping[str, Mapping[str, str]], classes: dict[str, Any], fallback: str
) -> None:
    """Read a class of defaults, which inherits those of the class that contains it."""
    merged = {tag: dict(values) for tag, values in inherited.items()}
    for child in element:
        if child.tag == "default":
            continue
        tag = "actuator" if child.tag in ACTUATORS else str(child.tag)
        merged[tag] = merged.get(tag, {}) | dict(child.attrib)
    name = element.get("class") or fallback
    classes[name] = {**classes.get(name, {}), **merged}
    for child in element.iterfind("default"):
        _read_defaults(child, merged, classes, fallback)
