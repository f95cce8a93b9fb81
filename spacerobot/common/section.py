"""Base of all sections of a scenario: strict keys, finite numbers, a unit for each number."""

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
"""Name of a robot, tip or grasp: letters, digits, ``_`` and ``-``, so that dotted paths stay unambiguous."""

Vector = tuple[float, float, float]
"""Three components along x, y, z."""

Paths = Annotated[
    tuple[str, ...],
    Field(min_length=1),
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
]
"""Dotted paths of a number, at least one; a single path stands for a list of one."""

SIGNALS_UNIT = "signal's unit"
"""Unit of a number that is in the unit of the section it stands in."""


LARGEST = 1e100
"""Larger numbers are refused: what is computed of them, as products of three, is infinite."""


class Section(BaseModel):
    """A part of a scenario: frozen, unknown keys refused, numbers finite and not beyond :data:`LARGEST`.

    Every number is in SI units unless its name ends in another one (``_deg``); the unit is part of the
    field's description and of the exported JSON schema.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def known_keys(cls) -> Collection[str]:
        """Keys that the section may have."""
        return cls.model_fields

    @classmethod
    def unit_of(cls, key: str, *, rotation: bool = False) -> str | None:
        """Unit of a key's number; None if its field states none.

        Args:
            key: Key of the section.
            rotation: Whether the section controls a rotation, whose unit may differ.

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
        """Refuse unknown keys with the near names, and truth values where a number belongs."""
        if not isinstance(data, dict):
            return data
        known, fields = cls.known_keys(), cls.model_fields
        for key, value in data.items():
            if key not in known:
                kind = f" (kind: {data['kind']})" if "kind" in fields and "kind" in data else ""
                raise ValueError(f"unknown key {key!r}; {near_names(str(key), known)}{kind}")
            items = value if isinstance(value, list | tuple) else (value,)
            if any(item is True or item is False for item in items):
                if key not in fields or fields[key].annotation not in (bool, bool | None):
                    raise ValueError(f"{key}: found {value!r}, a truth value, which is not allowed here")
            elif isinstance(value, int | float | list | tuple):
                _check_size(key, value)
        return data


@dataclass(frozen=True)
class OneOf:
    """Annotation of a text: one of the names that are registered when it is read.

    Attributes:
        names: Returns them.
    """

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema that looks the names up at each validation."""
        del source, handler

        def known(value: Any) -> str:
            """The text, if it is one of them."""
            found = tuple(self.names())
            if value in found:
                return str(value)
            named = [repr(name) for name in found]
            expected = " or ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
            near = near_names(str(value), found)
            hint = f"{near} " if near.startswith("did") else ""
            expected += f"; {hint}your own come with --plugin FILE"
            raise PydanticKnownError("literal_error", {"expected": expected})

        return core_schema.no_info_plain_validator_function(
            known, serialization=core_schema.to_string_ser_schema()
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The names as an enumeration."""
        del schema, handler
        return {"enum": list(self.names()), "type": "string"}


def _check_size(key: str, value: Any) -> None:
    """Refuse numbers, also in lists, that are finite and yet too large to compute with.

    Raises:
        ValueError: Its text begins with the key.
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
"""Key of a field's schema: how often its time may fit into the simulated one."""

MAX_SAMPLES, MAX_STEPS, MAX_PLANS = 10_000_000, 1_000_000_000, 100_000
"""Largest numbers of samples, of steps of integration and of plans in a simulation."""


def quantity(
    unit: str, description: str, *, rotation: str | None = None, recurs: int | None = None, **options: Any
) -> Any:
    """Pydantic field of a physical quantity; ``options`` go to :func:`pydantic.Field`.

    Args:
        unit: Unit as written in the documentation, ``1`` for a pure number.
        description: What it is.
        rotation: Unit where the section is that of a controller of rotation; the same if None.
        recurs: Of a period or step [s]: how often it may fit into the simulated time, as :data:`MAX_SAMPLES`.
        **options: ``default``, ``ge``, ``gt``, ``le``, ... as for :func:`pydantic.Field`.
    """
    units: dict[str, Any] = {"unit": unit} | ({"unit_of_rotation": rotation} if rotation else {})
    units |= {} if recurs is None else {RECURS: recurs}
    return Field(description=f"{description} [{unit}]", json_schema_extra=units, **options)


def matching(names: Iterable[str], pattern: str) -> list[str]:
    """Names that a pattern stands for, in their order; ``*`` matches any letters."""
    expression = ".*".join(re.escape(part) for part in pattern.split("*"))
    return [name for name in names if re.fullmatch(expression, name)]


def leaves(document: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every leaf (number, text, truth value, null) with its dotted path, in the document's order."""
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
    """Every number of a document with its dotted path, in the document's order."""
    for path, value in leaves(document, prefix):
        if is_number(value):
            yield path, float(value)


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a number, which a truth value is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)
