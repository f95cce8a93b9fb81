"""Registries: families of named entries, one file each, loaded at first use.

The names are those of the files, so that help texts and the schema list them without loading the entries.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import pkgutil
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from spacerobot.common.errors import SpaceRobotError, near_names

Method = TypeVar("Method", bound=Callable[..., Any])
_REQUIREMENT = "__required__"
SHIPPED = ("spacerobot.", "optim.", "viz.")
"""Packages whose classes are checked by type checkers and tests instead."""


@dataclass(frozen=True)
class Requirement:
    """Condition under which a registered class must define a method of its base class.

    Attributes:
        condition: Class attribute that must be set (``has_springs``) or not set (``not is_halfspace``) for
            the requirement to apply; it always applies if empty.
        instead: Method that may be defined instead; none if empty.
    """

    condition: str = ""
    instead: str = ""

    def applies(self, kind: type[Any], name: str) -> bool:
        """Whether a class that does not define a method must define it."""
        attribute = self.condition.removeprefix("not ")
        is_set = not attribute or getattr(kind, attribute) not in (None, False)
        if is_set == self.condition.startswith("not "):
            return False
        base = next(base for base in kind.__mro__ if name in vars(base))
        # the alternative counts as defined if the class does not share it with the base class
        alternative, inherited = (inspect.getattr_static(one, self.instead, None) for one in (kind, base))
        return alternative is inherited

    def __str__(self) -> str:
        """Condition and alternative in words, in parentheses; empty without any."""
        negated = self.condition.startswith("not ")
        words = [f"{'unless' if negated else 'with'} {self.condition.removeprefix('not ')}"]
        words = words if self.condition else []
        words += [f"or {self.instead}"] if self.instead else []
        return f" ({', '.join(words)})" if words else ""


def required(condition: str = "", instead: str = "") -> Callable[[Method], Method]:
    """Mark a method of a base class that registered classes must define; see :class:`Requirement`."""

    def mark(method: Method) -> Method:
        setattr(method, _REQUIREMENT, Requirement(condition, instead))
        return method

    return mark


def requirement(kind: type[Any], name: str) -> Requirement | None:
    """Requirement on a method that a class does not define; None for a defined or optional method."""
    return _mark_of(inspect.getattr_static(kind, name))


def _mark_of(member: Any) -> Requirement | None:
    function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
    return getattr(function, _REQUIREMENT, None)


@functools.cache
def _marked_names(base: type[Any]) -> tuple[str, ...]:
    """Names of the members that a class itself marks as required."""
    return tuple(name for name, member in vars(base).items() if isinstance(_mark_of(member), Requirement))


def check_methods(kind: type[Any]) -> None:
    """Check that a class defines all required methods, and a plugin's methods the base class's arguments.

    Raises:
        SpaceRobotError: If methods are missing or have other arguments; the message has their names.
    """
    if not kind.__module__.startswith(SHIPPED):
        _check_arguments(kind)
    missing = []
    # only marked names are looked up, since the check runs at every start for every shipped kind
    for name in sorted({name for base in kind.__mro__[1:] for name in _marked_names(base)}):
        lacking = requirement(kind, name)
        if lacking is not None and lacking.applies(kind, name):
            missing.append(f"{name}{lacking}")
    if missing:
        parts = "method" if len(missing) == 1 else "methods"
        raise SpaceRobotError(
            f"lacks the required {parts} {', '.join(missing)}", where=f"{kind.__module__}.{kind.__qualname__}"
        )


def _check_arguments(kind: type[Any]) -> None:
    """Check that the methods of a class can be called as those of its base classes that they override.

    Raises:
        SpaceRobotError: If a method cannot.
    """
    for name, method in vars(kind).items():
        base = next((vars(each)[name] for each in kind.__mro__[1:] if name in vars(each)), None)
        if not (inspect.isfunction(method) and inspect.isfunction(base)) or name.startswith("__"):
            continue
        own, expected = inspect.signature(method), inspect.signature(base)
        kinds = {parameter: each.kind for parameter, each in expected.parameters.items()}
        positional = [name for name, each in kinds.items() if each <= inspect.Parameter.POSITIONAL_OR_KEYWORD]
        keywords = dict.fromkeys(n for n, each in kinds.items() if each == inspect.Parameter.KEYWORD_ONLY)
        try:
            own.bind(*positional, **keywords)
        except TypeError:
            place = f"{kind.__module__}.{kind.__qualname__}"
            names = (", ".join(signature.parameters) for signature in (own, expected))
            found, allowed = (f"{name}({arguments})" for arguments in names)
            raise SpaceRobotError(f"found {found}, allowed: {allowed}", where=place) from None


class Entry(Protocol):
    """An entry of a registry.

    Attributes:
        name: Name in scenarios, options and files; for a shipped entry also the name of its module.
        place: Position in lists, which are sorted by position and then by name.
    """

    @property
    def name(self) -> str:
        """Name of the entry."""

    @property
    def place(self) -> float:
        """Position of the entry in lists."""


Registered = TypeVar("Registered", bound=Entry)


class Registry:
    """A family of entries, registered by the modules of a package and by plugins.

    Args:
        family: Name of the family in messages, in the singular.
        package: Package whose modules register the shipped entries.
        named_by_file: Whether each module registers one entry with the module's name. Otherwise the entries
            are functions with a decorator of the family's name.
    """

    def __init__(self, family: str, package: str, *, named_by_file: bool = True) -> None:
        self.family, self.package, self.named_by_file = family, package, named_by_file
        self._entries: dict[str, Any] = {}
        self._modules: dict[str, str] = {}
        self._loaded = False

    def add(self, entry: Registered, module: str | None = None) -> Registered:
        """Add an entry.

        Args:
            entry: The entry.
            module: Module that defines it; that of its class if None.

        Raises:
            SpaceRobotError: If another module has registered an entry of the same name.
        """
        module = module or type(entry).__module__
        is_shipped = module.startswith(f"{self.package}.")
        is_foreign_duplicate = (
            not is_shipped and entry.name not in self._entries and entry.name in self.names()
        )
        if is_foreign_duplicate or self._modules.get(entry.name, module) != module:
            raise SpaceRobotError(f"the {self.family} {entry.name!r} is registered already")
        self._entries[entry.name], self._modules[entry.name] = entry, module
        return entry

    def remove(self, name: str) -> None:
        """Remove an entry that was added."""
        del self._entries[name], self._modules[name]

    def names(self) -> tuple[str, ...]:
        """Names of all entries in alphabetical order; no entry is loaded."""
        shipped = self._shipped() if self.named_by_file else self._decorated()
        return tuple(sorted({*shipped, *self._entries}))

    def entries(self) -> Mapping[str, Any]:
        """All entries by name, in the order of their places."""
        if not self._loaded:
            self._loaded = True
            for name in self._shipped():
                importlib.import_module(f"{self.package}.{name}")
        ordered = sorted(self._entries.items(), key=lambda item: (item[1].place, item[0]))
        return MappingProxyType(dict(ordered))

    def check(self, name: str) -> None:
        """Check that there is an entry of a name; no entry is loaded.

        Raises:
            SpaceRobotError: If there is no such entry; the message has similar names.
        """
        if name not in self.names():
            raise SpaceRobotError(f"no {self.family} {name!r}; {near_names(name, self.names())}")

    def find(self, name: str) -> Any:
        """Find an entry by its name.

        Raises:
            SpaceRobotError: If there is no such entry; the message has similar names.
        """
        if name not in self._entries and not self.named_by_file:
            self.entries()
        elif name not in self._entries and name in self._shipped():
            importlib.import_module(f"{self.package}.{name}")
        if name not in self._entries:
            self.check(name)
        return self._entries[name]

    def _shipped(self) -> tuple[str, ...]:
        """Names of the package's modules."""
        return tuple(module.name for module in pkgutil.iter_modules(self._folders()))

    def _decorated(self) -> tuple[str, ...]:
        """Names of the package's functions with the family's decorator, read from the modules' texts."""
        function = re.compile(rf"^@{self.family}\(.*?^def (\w+)", re.MULTILINE | re.DOTALL)
        files = [file for folder in self._folders() for file in Path(folder).glob("*.py")]
        return tuple(name for file in files for name in function.findall(file.read_text(encoding="utf-8")))

    def _folders(self) -> Sequence[str]:
        specification = importlib.util.find_spec(self.package)
        assert specification is not None
        assert specification.submodule_search_locations is not None
        return specification.submodule_search_locations


Class = TypeVar("Class", bound=type[Any])


def registered(kind: Class) -> Class:
    """Decorator that adds an instance of a class to the registry of its base class.

    Raises:
        SpaceRobotError: If another entry has the same name, or the class lacks a required method.
    """
    check_methods(kind)
    kind.registry.add(kind())
    return kind


SAMPLERS = Registry("sampler", "spacerobot.samplers.kinds")
"""Samplers of campaigns: :class:`spacerobot.samplers.Sampler`."""

TUNING_METHODS = Registry("method", "optim.methods.kinds")
"""Tuning methods: :class:`optim.methods.TuningMethod`."""

FIGURES = Registry("figure", "viz.figures", named_by_file=False)
"""Figures of results: :class:`viz.figures.FigureKind`."""

ESTIMATORS = Registry("estimator", "optim.reliability.kinds")
"""Estimators of failure probabilities: :class:`optim.reliability.estimator.ProbabilityEstimator`."""

COMMANDS = Registry("command", "spacerobot.cli.commands")
"""Commands of the command line: :class:`spacerobot.cli.command.Command`."""

EXPORT_FORMATS = Registry("format", "spacerobot.exports.formats")
"""Export formats: :class:`spacerobot.exports.ExportFormat`."""
