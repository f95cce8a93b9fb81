"""Base class of all sections of a scenario: strict keys, finite numbers, a unit for each number."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, TypeGuard

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from spacerobot.common.errors import near_names

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$", max_length=64)]
"""Name of a robot, tip or grasp: letters, digits, ``_`` and ``-``, so that dotted paths are unambiguous."""

Vector = tuple[float, float, float]
"""Three components along x, y, z."""

Paths = Annotated[
    tuple[str, ...],
    Field(min_length=1),
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
]
"""Dotted paths of numbers, at least one; a single path is accepted as a list of one."""

SIGNALS_UNIT = "signal's unit"
"""Unit of a number that has the unit of the signal that its section describes."""


LARGEST = 1e100
"""Maximum magnitude of a number: products of three still are finite."""


class Section(BaseModel):
    """A section of a scenario: immutable, without unknown keys, with finite numbers up to :data:`LARGEST`.

    Every number is in SI units unless its name ends with another unit (``_deg``). The unit is part of the
    field's description and of the exported JSON schema.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def known_keys(cls) -> Collection[str]:
        """Allowed keys of the section."""
        return cls.model_fields

    @classmethod
    def unit_of(cls, key: str, *, rotation: bool = False) -> str | None:
        """Unit of a number; None if its field has no unit.

        Args:
            key: Key of the number.
            rotation: Whether the section is that of a rotation controller, whose units may differ.

        Raises:
            KeyError: If the section has no such key.
        """
        extra = cls.model_fields[key].json_schema_extra
        if not isinstance(extra, dict):
            return None
        return str(extra.get("unit_of_rotation", extra["unit"]) if rotation else extra["unit"])

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        """Check that all keys are allowed, and that numbers are not truth values."""
        if not isinstance(data, dict):
            return data
        keys, fields = cls.known_keys(), cls.model_fields
        for key, value in data.items():
            if key not in keys:
                kind = f" (kind: {data['kind']})" if "kind" in fields and "kind" in data else ""
                raise ValueError(f"unknown key {key!r}; {near_names(str(key), keys)}{kind}")
            items = value if isinstance(value, list | tuple) else (value,)
            if any(item is True or item is False for item in items):
                if key not in fields or fields[key].annotation not in (bool, bool | None):
                    raise ValueError(f"{key}: found {value!r}, a truth value, which is not allowed here")
            elif isinstance(value, int | float | list | tuple):
                _check_size(key, value)
        return data


@dataclass(frozen=True)
class OneOf:
    """Annotation of a text that must be one of the names registered at the time of validation.

    Attributes:
        names: Function that returns the names.
    """

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema that looks up the names at each validation."""
        del source, handler

        def validated(value: Any) -> str:
            """Text, after a check that it is one of the names."""
            names = tuple(self.names())
            if value in names:
                return str(value)
            quoted = [repr(name) for name in names]
            expected = " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)
            near = near_names(str(value), names)
            hint = f"{near} " if near.startswith("did") else ""
            expected += f"; {hint}your own come with --plugin FILE"
            raise PydanticKnownError("literal_error", {"expected": expected})

        return core_schema.no_info_plain_validator_function(
            validated, serialization=core_schema.to_string_ser_schema()
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Enumeration of the names."""
        del schema, handler
        return {"enum": list(self.names()), "type": "string"}


def _check_size(key: str, value: Any) -> None:
    """Check that finite numbers, also in lists, are not too large to compute with.

    Raises:
        ValueError: If a number is too large; the message begins with the key.
    """
    if isinstance(value, list | tuple):
        for item in value:
            _check_size(key, item)
    elif isinstance(value, int) and value.bit_length() > 63:
        size = f"{value}" if value.bit_length() < 100 else f"some 1e{int(value.bit_length() * math.log10(2))}"
        raise ValueError(
            f"{key}: found {size}, a whole number of more than 64 bits; write 1.0e20 for a large number"
        )
    elif isinstance(value, float) and LARGEST < abs(value) < math.inf:
        raise ValueError(f"{key}: found {value:g}, allowed: numbers up to {LARGEST:g}")


RECURS = "at_most_in_simulation"
"""Key in a field's schema of the maximum number of its periods or steps in a simulation."""

MAX_SAMPLES, MAX_STEPS, MAX_PLANS = 10_000_000, 1_000_000_000, 100_000
"""Maximum numbers of samples, of integration steps and of plans in a simulation."""


def quantity(
    unit: str, description: str, *, rotation: str | None = None, recurs: int | None = None, **options: Any
) -> Any:
    """Pydantic field of a physical quantity.

    Args:
        unit: Unit as in the documentation; ``1`` for a dimensionless number.
        description: Description of the quantity, without its unit.
        rotation: Unit in the section of a rotation controller; ``unit`` if None.
        recurs: Maximum number of the period or step [s] in a simulation, such as :data:`MAX_SAMPLES`.
        **options: Arguments of :func:`pydantic.Field`: ``default``, ``ge``, ``gt``, ``le``, ...
    """
    units: dict[str, Any] = {"unit": unit} | ({"unit_of_rotation": rotation} if rotation else {})
    units |= {} if recurs is None else {RECURS: recurs}
    return Field(description=f"{description} [{unit}]", json_schema_extra=units, **options)


def matching(names: Iterable[str], pattern: str) -> list[str]:
    """Names that match a pattern, in their order; ``*`` matches any characters."""
    expression = ".*".join(re.escape(part) for part in pattern.split("*"))
    return [name for name in names if re.fullmatch(expression, name)]


def leaves(document: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Iterate over leaves (numbers, texts, truth values, null) and their dotted paths, in document order."""
    if isinstance(document, dict):
        items: list[tuple[Any, Any]] = list(document.items())
    elif isinstance(document, list | tuple):
        items = list(enumerate(document))
    else:
        yield prefix, document
        return
    for key, value in items:
        yield from leaves(value, f"{prefix}.{key}" if prefix else str(key))


def numbers(document: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Iterate over the numbers of a document and their dotted paths, in document order."""
    for path, value in leaves(document, prefix):
        if is_number(value):
            yield path, float(value)


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a number; truth values are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)
