"""Registry of all kinds of elements by family: shipped, installed, and added by a user."""

from __future__ import annotations

import difflib
import functools
import hashlib
import importlib
import importlib.util
import operator
import pkgutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter, ValidationInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from spacerobot.common.errors import FORMER_NAMES, SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.common.registry import Registry, check_methods, registered
from spacerobot.elements.core.element import Element

GROUP = "spacerobot.elements"
"""Entry-point group of installed plugins: each entry names a module that registers kinds."""

FAMILIES = {
    "reference": "spacerobot.elements.references",
    "grasp": "spacerobot.elements.grasps",
    "contact": "spacerobot.elements.contacts",
    "tip_controller": "spacerobot.elements.controllers",
    "robot_controller": "spacerobot.elements.controllers",
    "actuator": "spacerobot.elements.actuators",
    "sensor": "spacerobot.elements.sensors",
    "estimator": "spacerobot.elements.estimators",
    "environment": "spacerobot.elements.environments",
    "flexible_link": "spacerobot.elements.flexible",
    "shape": "spacerobot.elements.shapes",
}
"""Families of a closed loop, with the package whose modules hold the shipped kinds."""

PLANS = {
    "goal": "spacerobot.elements.goals",
    "plan_limit": "spacerobot.elements.limits",
}
"""Families of plans, which are not part of a closed loop."""

QUANTITY_KINDS = {"plan_limit": "spacerobot.elements.limits.quantity_limit"}
"""Families with kinds that registered quantities define, and the module that makes those."""

_HOMES = FAMILIES | PLANS
_KINDS: dict[str, dict[str, type[Element]]] = {family: {} for family in _HOMES}
_LOADED: set[str] = set()
_PLUGINS: dict[Path, bytes] = {}

Kind = TypeVar("Kind", bound=type[Any])


def register(kind: Kind) -> Kind:
    """Register a kind of element, sampler, tuning method, figure or command; used as a class decorator.

    Raises:
        SpaceRobotError: If the class belongs to no family, has no ``kind`` or documentation, lacks a required
            method, or its name is taken.
    """
    if isinstance(getattr(kind, "registry", None), Registry):
        return registered(kind)
    where = f"{kind.__module__}.{kind.__qualname__}"
    family = getattr(kind, "family", None)
    if family not in _HOMES or not issubclass(kind, Element):
        raise SpaceRobotError(f"family {family!r}, {near_names(str(family), _HOMES)}", where=where)
    name = kind_of(kind)
    if not name:
        raise SpaceRobotError('no kind; write `kind: Literal["name"] = "name"`', where=where)
    if not kind.__doc__:
        raise SpaceRobotError("no docstring; the documentation needs its first line", where=where)
    if not kind.__module__.startswith(_HOMES[family]):
        _load_shipped(family)  # whose names are taken
    registered_kind = _KINDS[family].get(name)
    if registered_kind is not None and (registered_kind.__module__, registered_kind.__qualname__) != (
        kind.__module__,
        kind.__qualname__,
    ):
        holder = f"{registered_kind.__module__}.{registered_kind.__qualname__}"
        raise SpaceRobotError(f"the {family} kind {name!r} is taken by {holder}", where=where)
    check_methods(kind)
    _KINDS[family][name] = kind
    return kind


def kind_of(element: type[Element]) -> str:
    """Name of a kind in a scenario; empty if it has none."""
    annotation = element.model_fields["kind"].annotation
    values = get_args(annotation) if get_origin(annotation) is Literal else ()
    return str(values[0]) if values else ""


def kinds(family: str) -> Mapping[str, type[Element]]:
    """Kinds of a family by name: shipped kinds in alphabetical order, then registered ones."""
    _load_shipped(family)
    if GROUP not in _LOADED:
        _LOADED.add(GROUP)
        for point in entry_points(group=GROUP):
            point.load()
    shipped = _HOMES[family]
    ordered = sorted(
        _KINDS[family].items(), key=lambda kind: (not kind[1].__module__.startswith(shipped), kind[0])
    )
    return MappingProxyType(dict(ordered))


def find_kind(family: str, name: str) -> type[Element] | None:
    """Kind with a given name, None if there is none; of shipped kinds only that file is loaded."""
    if name not in _KINDS[family] and name in _shipped_modules(_HOMES[family]):
        importlib.import_module(f"{_HOMES[family]}.{name}")
    _add_kinds_of_quantities(family)
    return _KINDS[family].get(name) or kinds(family).get(name)


def create(family: str, kind: str, **values: Any) -> Any:
    """Section of a registered kind; missing keys have their defaults.

    Args:
        family: Family of the kind, such as ``reference``.
        kind: Name of the kind.
        **values: Values of the section, by key.

    Raises:
        pydantic.ValidationError: If the kind does not allow a value.
        KeyError: If the family or kind is unknown.
    """
    kind_class = find_kind(family, kind)
    if kind_class is None:
        raise KeyError(kind)
    return kind_class.model_validate({"kind": kind} | values)


def only_shipped() -> bool:
    """Whether every kind of element that has been loaded ships with this package."""
    return all(kind.__module__.startswith(home) for f, home in _HOMES.items() for kind in _KINDS[f].values())


def load_plugin(path: StrPath) -> None:
    """Run a Python file that registers kinds; a file that ran before runs again only if it changed.

    Raises:
        SpaceRobotError: If the file does not exist or fails; the message names the failing line.
    """
    path = Path(path)
    if not path.is_file():
        raise SpaceRobotError("no such file", source=path)
    text = path.read_bytes()
    if _PLUGINS.get(path.resolve()) == text:
        return
    name = f"spacerobot_plugin_{path.stem}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise SpaceRobotError("not a Python file", source=path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except SpaceRobotError as fault:
        raise SpaceRobotError(fault.message, source=path, where=fault.where) from None
    except Exception as fault:
        # line of a file in which an exception arose, if it did there
        line, trace = None, fault.__traceback__
        while trace is not None:
            if trace.tb_frame.f_code.co_filename == str(path):
                line = f"line {trace.tb_lineno}"
            trace = trace.tb_next
        raise SpaceRobotError(f"{type(fault).__name__}: {fault}", source=path, where=line) from None
    _PLUGINS[path.resolve()] = text


def plugins() -> tuple[Path, ...]:
    """Files loaded by :func:`load_plugin`, in order; other processes need them for the same scenario."""
    return tuple(_PLUGINS)


def plugin_options() -> list[str]:
    """Command-line options that load the present plugins."""
    return [word for path in _PLUGINS for word in ("--plugin", str(path))]


def plugin_records() -> list[dict[str, str]]:
    """Records of the plugins for results: ``file``, absolute, and its ``sha256``."""
    return [
        {"file": str(path), "sha256": hashlib.sha256(text).hexdigest()} for path, text in _PLUGINS.items()
    ]


def _load_shipped(family: str) -> None:
    package = _HOMES[family]
    if package not in _LOADED:
        _LOADED.add(package)
        for name in _shipped_modules(package):
            importlib.import_module(f"{package}.{name}")
    _add_kinds_of_quantities(family)


def _add_kinds_of_quantities(family: str) -> None:
    """Register the kinds of quantities that were registered since the last call."""
    if family in QUANTITY_KINDS:
        for kind in importlib.import_module(QUANTITY_KINDS[family]).new_kinds(_KINDS[family]):
            register(kind)


@functools.cache
def _shipped_modules(package: str) -> tuple[str, ...]:
    """Names of a package's modules."""
    return tuple(module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__))


@dataclass(frozen=True)
class Family:
    """Annotation of a field: a section of any registered kind of a family, identified by ``kind``.

    Attributes:
        name: Name of the family.
        default: Kind of a section without ``kind``; the section must name one if None.
        only: Only kind that the field accepts, where its key names it; any kind of the family if None.
    """

    name: str
    default: str | None = None
    only: str | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema that finds the kind of a section when it is validated, and loads no other kind."""
        del source, handler

        def validate(value: Any, info: ValidationInfo) -> Any:
            """Element of a section, of the kind given by ``kind``, by default or by a key."""
            if not isinstance(value, dict | Element):
                raise PydanticCustomError("dict_type", "a section is required")
            if isinstance(value, dict) and self.only is None:
                value = self._with_kind(value)
            name = self.only or (value.get("kind") if isinstance(value, dict) else value.kind)
            kind = find_kind(self.name, name) if isinstance(name, str) else None
            if kind is None:
                # the kind that was found, the registered kinds and those with similar names
                names = tuple(kinds(self.name))
                allowed = f"allowed: {', '.join(names)}"
                message = f"missing, {allowed}"
                if not isinstance(value, dict) or "kind" in value:
                    near = difflib.get_close_matches(str(name), names, n=2)
                    hint = f"did you mean {' or '.join(near)}? " if near else ""
                    message = f"found {name!r}, {allowed}; {hint}your own come with --plugin FILE"
                raise PydanticCustomError("unknown_kind", "{told}", {"told": message})
            return kind.model_validate(value, context=info.context)

        return core_schema.with_info_plain_validator_function(validate)

    def _with_kind(self, section: dict[Any, Any]) -> dict[Any, Any]:
        """Section with its kind: the default kind, or the kind that has one of its keys."""
        if self.default is not None:
            section = {"kind": self.default} | section
        if "kind" in section:
            return section
        keys = {kind.told_by: name for name, kind in kinds(self.name).items() if kind.told_by}
        if keys:
            present_keys = [key for key in keys if section.get(key)]
            if len(present_keys) != 1:
                message = f"found {', '.join(present_keys) or 'none'}, allowed: one of {', '.join(keys)}"
                raise PydanticCustomError("unknown_kind", "{told}", {"told": message})
            return {"kind": keys[present_keys[0]]} | section
        former = [key for key in section if FORMER_NAMES.get(key) == "kind"]
        if former:
            raise ValueError(f"unknown key {former[0]!r}; use 'kind'")
        return section

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Schema for editors: all kinds of the family; a section without ``kind`` has the default kind."""
        del schema
        union: Any = functools.reduce(operator.or_, kinds(self.name).values())
        json_schema = handler(TypeAdapter[Any](Annotated[union, Field(discriminator="kind")]).core_schema)
        if self.only is not None:
            return {"$ref": json_schema["discriminator"]["mapping"][self.only]}
        if self.default is None:
            return json_schema
        default = json_schema["discriminator"]["mapping"][self.default]
        json_schema["oneOf"] = [
            each if each["$ref"] == default else each | {"required": ["kind"]}
            for each in json_schema["oneOf"]
        ]
        return json_schema
