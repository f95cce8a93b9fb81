"""Texts and numbers of a scenario as C source."""

from __future__ import annotations

import re
from collections.abc import Collection

KEYWORDS = {"auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum"}
KEYWORDS |= {"extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict"}
KEYWORDS |= {"return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union"}
KEYWORDS |= {"unsigned", "void", "volatile", "while"}
"""Keywords of C99 in lower case."""

MEMBERS = {"arg", "copy", "i", "inputs", "last", "outputs", "res", "state", "tick", "time", "work"}
"""Names in the C sources that no field may have."""

FUNCTIONS = {"allocate", "flow", "init", "output", "step"}
"""Names of functions that no task of an event may have."""

PROGRAMS = {"all", "clean", "controller", "install", "m", "processor_in_the_loop", "processor_table", "test"}
PROGRAMS |= {"test_vectors", "vector_table"}
"""Names of files and of CMake targets that the software may not have."""


def identifier(path: str, used: Collection[str] = ()) -> str:
    """C identifier of a path, in lower case.

    Args:
        path: Any text. Characters other than ASCII letters and digits become underscores.
        used: Names in use, from which a number as suffix distinguishes the result.
    """
    name = re.sub(r"[^0-9A-Za-z]+", "_", path).strip("_").lower()
    if not name or name[0].isdigit():
        name = f"n{name}"
    free, number = name, 2
    while free in used or free in KEYWORDS:
        free, number = f"{name}_{number}", number + 1
    return free


def comment_text(text: str) -> str:
    """Text for a comment of one line: it neither begins nor ends a comment, and has no trigraphs."""
    text = " ".join(text.split())
    for mark in ("*/", "/*", "??"):
        while mark in text:
            text = text.replace(mark, " ".join(mark))
    return text


def number_literal(value: float) -> str:
    """Number as a C literal that is read back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".en") else f"{text}.0"
