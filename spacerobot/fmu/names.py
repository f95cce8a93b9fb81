"""Names of variables by FMI's convention ``structured``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from spacerobot.common.errors import SpaceRobotError

IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
QUOTABLE = re.compile(r"[A-Za-z0-9_ !#$%&()*+,\-./:;<>=?@\[\]^{}|~]+")
"""Characters of FMI's quoted names, without those that need a backslash."""


def structured(keys: Iterable[str | int]) -> str:
    """Name of a variable: words joined by dots, whole numbers as indices.

    A word that is no identifier is put between quotation marks: ``robots.'arm-2'.base.position[0]``.

    Args:
        keys: Words and indices, a word first.

    Raises:
        SpaceRobotError: If a word has a character that no name may have.
    """
    name = ""
    for key in keys:
        if isinstance(key, int):
            name += f"[{key}]"
            continue
        if not QUOTABLE.fullmatch(key):
            raise SpaceRobotError(
                f"found the name {key!r}, allowed in an FMU: letters of English, digits, blanks and "
                "!#$%&()*+,-./:;<>=?@[]^{}|~"
            )
        word = key if IDENTIFIER.fullmatch(key) else f"'{key}'"
        name += f".{word}" if name else word
    return name


def keys_at(document: Any, path: str) -> list[str | int]:
    """Keys and indices of a number of a document by its dotted path; a key may itself have dots.

    Args:
        document: Mappings and lists.
        path: Dotted path of one of its numbers.
    """
    keys: list[str | int] = []
    while path:
        if isinstance(document, dict):
            key = max((key for key in document if f"{path}.".startswith(f"{key}.")), key=len)
            keys.append(key)
            document, path = document[key], path[len(key) + 1 :]
        else:
            index, _, path = path.partition(".")
            keys.append(int(index))
            document = document[int(index)]
    return keys
