"""ES modules joined into one classic script, so that a page is one file whose script has one hash.

A browser lets no page at ``file://`` import another file, and a Content Security Policy that admits scripts
by hash admits none that is imported. So each module becomes the scope of a function, in the order in which
modules import each other:

    const $chart = (() => { const { digits } = $format; ...; return { Chart }; })();

Three forms of import and export are joined, and any other is refused: ``import { a, b as c } from "./d.js"``
and ``export`` before a declaration, each at the beginning of a line; ``export { a, b as c }`` at a file's
end. An export is read once, when its module has run: it must not be assigned to later.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from posixpath import dirname, join, normpath

from spacerobot.common.errors import SpaceRobotError

IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"([^"]+)";\n', re.M)
DECLARED = re.compile(r"^export (?=(?:async function|function|class|const)\s+(?:\{ )?([\w$]+))", re.M)
LISTED = re.compile(r"(?:^|(?<=;))export\s*\{([^}]*)\};?\n?", re.M)
COMMENT = re.compile(r"^[ \t]*(?://.*|/\*(?:[^*]|\*(?!/))*\*/[ \t]*)(?:\n|\Z)", re.M)
"""Comments on lines of their own, the reference to a source map among them; pages are sent without."""
LEFT = re.compile(r"^(?:import|export)\b.*", re.M)


def joined(entry: str, read: Callable[[str], str]) -> str:
    """Script equivalent to a module with its imports.

    Args:
        entry: Path of the module to run.
        read: Function that returns a module's text by its path.

    Returns:
        str: The script, in strict mode and in its own scope.

    Raises:
        SpaceRobotError: If modules import each other in a circle, or use another form of import or export.
    """
    scopes: dict[str, str] = {}
    importing: list[str] = []

    def visit(path: str) -> None:
        """Join a module after those that it imports."""
        if path in scopes:
            return
        if path in importing:
            raise SpaceRobotError(f"modules import each other in a circle: {' -> '.join([*importing, path])}")
        importing.append(path)
        text = read(path)
        for _, source in IMPORT.findall(text):
            visit(_resolved(path, source))
        importing.pop()
        # the module as a constant that holds its exports
        exports = DECLARED.findall(text)
        # "a as b" becomes {a: b} in an import, and {b: a} in an export
        for names in LISTED.findall(text):
            exports += [": ".join(reversed(name.split(" as "))) for name in _names(names)]
        body = LISTED.sub("", DECLARED.sub("", COMMENT.sub("", text)))
        body = IMPORT.sub(
            lambda match: (
                f"const {{ {', '.join(name.replace(' as ', ': ') for name in _names(match[1]))} }}"
                f" = {_constant(_resolved(path, match[2]))};\n"
            ),
            body,
        )
        if (other := LEFT.search(body)) is not None:
            message = f"{path}: this form of import or export cannot be joined: {other[0][:80]}"
            raise SpaceRobotError(message)
        exported = f"return {{ {', '.join(exports)} }};"
        scopes[path] = f"const {_constant(path)} = (() => {{\n{body}{exported}\n}})();"

    visit(entry)
    return '"use strict";\n(() => {\n' + "\n".join(scopes.values()) + "\n})();\n"


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _resolved(path: str, source: str) -> str:
    return normpath(join(dirname(path), source))


def _constant(path: str) -> str:
    """Name of a module's constant; paths of one folder tree that differ give names that differ."""
    return "$" + path.removesuffix(".js").replace("/", "$").replace(".", "_")
