"""Messages between the studio's page and server: JSON texts with a ``type``, and arrays.

A text with ``binary: [{name, shape}]`` is followed by one binary message of single-precision little-endian
arrays; ``name`` is the dotted path of the array in the JSON. ``values`` of a design are its differences
from the scenario by dotted path. Requests, and the answers:

- ``set`` (``seq``, ``values``): ``rollout`` with ``seq``, ``status``, ``metrics`` in the order of
  ``hello``, ``ledger``, ``events``, ``run``; a newer request cancels it.
- ``gradient`` (``seq``, ``values``, ``metric``, ``paths``): ``gradient`` with ``value``, ``d`` by path,
  ``status``; ``differences`` first where nothing is compiled yet.
- ``improve``, ``tune``, ``campaign`` (``values``, ``metric``; ``bounds`` by path, or ``spreads``;
  ``method``, ``budget`` or ``samples``): repeated ``job`` with ``id``, ``state``, ``progress``, ``best``,
  ``curve``, or ``values``, ``bands``, ``paths``. ``stop`` (``job``) ends it.
- ``margins`` (``values``, ``at`` in s): repeated ``job``, at last with ``loops``, the least disk margin
  first, their ``units``, the number of ``growing`` modes, the growth rate in 1/s of the ``fastest``, and
  whether the loops are ``destabilised``, or these modes are a drift of the motion.
- ``save`` (``what``, ``name``, ``values``): ``saving`` with ``words``, then ``saved`` with ``path``,
  ``command``.
- ``command`` (``values``): ``command`` with ``text``.
- ``urdfs`` (nothing, or ``name`` and ``text`` of an upload): ``urdfs`` with ``files``, ``uploaded``.
- ``draft`` (``robot``, ``target``, ``name``; ``tip``, ``frame``, ``point``, ``base``, ``position``,
  ``velocity``, ``spin_deg``): ``draft`` with ``text``, ``tips``, ``frames``, ``place``, ``show``.
- ``open`` (the same): ``moved`` to every page, which loads again. ``plan`` (``values``): repeated ``job``,
  ``moved``.

Unrequested: ``hello`` (numbers with units, ranges and descriptions; metrics; the scene), again when the
structure changes; ``compiling``; and ``failed`` with the request, the place of the error and what is
allowed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacerobot.common.errors import SpaceRobotError

MOST_BYTES = 256 * 1024
"""Maximum size of a message from the page [bytes]."""

MOST_VALUES = 2000
"""Maximum number of values of a design."""

MAX_DEPTH = 16
"""Maximum nesting depth of lists and mappings in a message."""

LARGEST = 1e300
"""Magnitude from which a number counts as infinite."""

KINDS = (
    *("set", "gradient", "improve", "tune", "campaign", "margins", "stop", "save", "command"),
    *("urdfs", "draft", "open", "plan"),
)
"""Requests that a page may send."""


@dataclass(frozen=True)
class Request:
    """Request of a page.

    Attributes:
        kind: One of ``KINDS``.
        values: Design of the request: differences from the scenario, by dotted path.
        seq: Sequence number, repeated in answers.
        more: Other fields of the request.
    """

    kind: str
    values: Mapping[str, Any] = field(default_factory=dict)
    seq: int = 0
    more: Mapping[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Refuse deep nesting, and numbers that are not finite.

        Raises:
            SpaceRobotError: If there is such a value; the message names its place.
        """
        _check(self.values)
        _check(self.more)

    def text(self, name: str, allowed: tuple[str, ...] = ()) -> str:
        """Text field of the request.

        Raises:
            SpaceRobotError: If it is missing, or not allowed.
        """
        value = self.more.get(name)
        if not isinstance(value, str) or (allowed and value not in allowed):
            raise SpaceRobotError(f"found {value!r}, allowed: {', '.join(allowed) or 'a text'}", where=name)
        return value

    def pairs(self, name: str) -> dict[str, Any]:
        """Mapping field of the request; empty if missing.

        Raises:
            SpaceRobotError: If it is something else.
        """
        value = self.more.get(name, {})
        if not isinstance(value, dict) or len(value) > MOST_VALUES:
            raise SpaceRobotError("allowed: a mapping of dotted paths", where=name)
        return value

    def count(self, name: str, default: int, most: int) -> int:
        """Integer field of the request.

        Raises:
            SpaceRobotError: If it is not an integer, or out of range.
        """
        value = self.more.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
            raise SpaceRobotError(f"found {value!r}, allowed: 1 to {most}", where=name)
        return value


def _check(node: Any, where: tuple[str, ...] = ()) -> None:
    """Refuse deep nesting, and numbers that are not finite or reach :data:`LARGEST`.

    Raises:
        SpaceRobotError: If there is such a value; the message names its place.
    """
    if isinstance(node, dict | list):
        if len(where) >= MAX_DEPTH:
            path = ".".join(where[:3])
            raise SpaceRobotError(f"nested too deeply, allowed: {MAX_DEPTH} levels", where=path)
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            _check(value, (*where, str(key)))
    elif isinstance(node, int | float) and not abs(node) < LARGEST:
        problem = f"found {node:.4g}, allowed: a finite number smaller than {LARGEST:g}"
        raise SpaceRobotError(problem, where=".".join(where))


def read(text: str | bytes) -> Request:
    """Request from a message.

    Raises:
        SpaceRobotError: If it is not a valid request.
    """
    try:
        # Python refuses to read whole numbers of more than 4300 digits; as floats they are infinite
        message = json.loads(
            text, parse_int=lambda digits: int(digits) if len(digits) < 300 else float(digits)
        )
    except RecursionError:
        raise SpaceRobotError(f"a message nested too deeply, allowed: {MAX_DEPTH} levels") from None
    except ValueError:
        raise SpaceRobotError("a message that is no JSON") from None
    if not isinstance(message, dict) or message.get("type") not in KINDS:
        raise SpaceRobotError(f"a message of no known type, allowed: {', '.join(KINDS)}")
    kind, values, seq = message.pop("type"), message.pop("values", {}), message.pop("seq", 0)
    if not isinstance(values, dict) or len(values) > MOST_VALUES:
        raise SpaceRobotError(f"allowed: a mapping of at most {MOST_VALUES} dotted paths", where="values")
    if isinstance(seq, bool) or not isinstance(seq, int):
        raise SpaceRobotError("allowed: a whole number", where="seq")
    return Request(kind, values, seq, message)


def packets(message: Mapping[str, Any]) -> list[str | bytes]:
    """Parts of a message to be sent: JSON, followed by its arrays if it has any.

    The JSON's ``binary`` names the dotted path and the shape of each array, in single precision.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    plain = _without(message, "", arrays)
    if arrays:
        plain["binary"] = [{"name": name, "shape": array.shape} for name, array in arrays.items()]
    text = json.dumps(plain, allow_nan=False, separators=(",", ":"))
    numbers = b"".join(np.ascontiguousarray(a, "<f4").tobytes() for a in arrays.values())
    return [text, numbers] if arrays else [text]


def _without(node: Any, path: str, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Plain data without its arrays, which are collected in ``arrays``; non-finite numbers become null."""
    if isinstance(node, Mapping):
        return {key: _without(value, f"{path}.{key}" if path else key, arrays) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_without(value, f"{path}.{i}", arrays) for i, value in enumerate(node)]
    if isinstance(node, np.ndarray):
        arrays[path] = node
        return None
    if isinstance(node, np.generic):
        node = node.item()
    return None if isinstance(node, float) and not math.isfinite(node) else node
