"""Conversion of pydantic's errors to one line with dotted path, value and allowed values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from spacerobot.scenario.paths import Document

_SECTION = "a section of keys and values"
_ALLOWED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text, in quotes if it looks like something else",
    "string_too_short": "at least {min_length} character",
    "string_too_long": "at most {max_length} characters",
    "tuple_type": "a list, as [0, 0, 1]",
    "too_short": "at least {min_length}",
    "too_long": "at most {max_length}",
    "dict_type": _SECTION,
    "model_type": _SECTION,
    "model_attributes_type": _SECTION,
    "literal_error": "{expected}",
    "greater_than": "above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
}
"""Allowed values by the type of pydantic's error; for other types, pydantic's own message is used."""

_PATTERNS = {
    r"^[A-Za-z_][A-Za-z0-9_-]*$": "letters, digits, _ and -, with a letter or _ in front",
    r"^[^/]+/[^/]+$": "robot/tip",
}
"""Meaning of patterns in the schema."""


def explain_all(errors: Iterable[Mapping[str, Any]], document: Document) -> dict[str, str]:
    """Messages of pydantic's errors by dotted path; values that alternatives allow are joined by ``or``."""
    messages: dict[str, str] = {}
    for error in errors:
        path, message = explain(error, document)
        head, separator, allowed = message.partition(", allowed: ")
        earlier = messages.setdefault(path, message)
        if message not in earlier and separator and earlier.startswith(head + separator):
            messages[path] = f"{earlier} or {allowed}"
        elif message not in earlier:
            messages[path] = f"{earlier}; {message}"
    return messages


def explain(error: Mapping[str, Any], document: Document) -> tuple[str, str]:
    """Dotted path and message of one of pydantic's errors."""
    # pydantic's location, without entries for union members; its last key may be missing in the document
    location = error["loc"]
    path: list[str] = []
    node: Any = document
    for key in location:
        if key == "[key]":
            continue
        if isinstance(node, int | float | str) or (isinstance(node, list | tuple) and isinstance(key, str)):
            break  # a value in place of a section
        path.append(str(key))
        if isinstance(node, dict):
            node = node.get(key)
        else:
            inside = isinstance(node, list | tuple) and isinstance(key, int) and key < len(node)
            node = node[key] if inside else None
    kind, value = str(error["type"]), error["input"]
    message = str(error["msg"]).removeprefix("Value error, ")
    if kind == "missing" and path and path[-1].isdecimal():
        return ".".join(path[:-1]), f"found {_short(value)}, allowed: a longer list"
    if kind == "missing":
        return ".".join(path), "missing"
    if kind == "unknown_kind":
        return ".".join([*path, "kind"]), message
    if kind == "value_error":
        named = re.match(r"([\w*.-]+): (.*)", message, re.DOTALL)  # a message that begins with a key
        if named:
            path, message = [*path, named[1]], named[2]
        return ".".join(path), message
    context = error.get("ctx", {})
    if kind == "string_pattern_mismatch":
        allowed = _PATTERNS.get(str(context["pattern"]))
    else:
        allowed = _ALLOWED[kind].format(**context) if kind in _ALLOWED else None
    if allowed is None:
        return ".".join(path), f"{message[:1].lower()}{message[1:]}, found {_short(value)}"
    return ".".join(path), f"found {_short(value)}, allowed: {allowed}"


def _short(value: Any) -> str:
    if value is None:
        return "null"
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."
