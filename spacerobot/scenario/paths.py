"""Dotted paths in a scenario's document, such as ``robots.*.tips.tip.pid.kp``.

A document is the plain form of a scenario: nested dictionaries and lists. Segments are keys or list indices.
``*`` matches every key; inside a segment it matches any characters. A key may contain dots, as names of URDF
links do.
"""

from __future__ import annotations

import copy
from typing import Any

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import matching

Document = dict[str, Any]


def expand(document: Any, pattern: str) -> list[str]:
    """Dotted paths that match a pattern.

    Raises:
        ScenarioError: If a segment is not in the document; the message has similar names.
    """
    return [".".join(path) for path in _expand(document, pattern.split("."), pattern)]


def get(document: Any, path: str) -> Any:
    """Value at a dotted path.

    Raises:
        ScenarioError: If a segment is not in the document, or the path matches several values.
    """
    matches = _expand(document, path.split("."), path)
    if len(matches) != 1:
        raise ScenarioError(f"matches {len(matches)} values, where one is required", where=path)
    for key in matches[0]:
        document = document[int(key) if isinstance(document, list | tuple) else key]
    return document


def assign(document: Document, pattern: str, value: Any) -> Document:
    """Copy of a document with a value at every path that matches a pattern.

    A null section on the path becomes an empty one, and new keys may be added to a section. Validation checks
    them afterwards.

    Raises:
        ScenarioError: If ``*`` matches nothing, or a section on the path does not exist.
    """
    changed = copy.deepcopy(document)
    segments = pattern.split(".")
    parents = [()] if len(segments) == 1 else _expand(changed, segments[:-1], pattern, open_null=True)
    for parent in parents:
        node: Any = changed
        for key in parent:
            node = node[int(key) if isinstance(node, list) else key]
        key = segments[-1]
        if isinstance(node, dict):
            names = matching(node, key) if "*" in key else [key]
            if not names and key != "*":
                raise ScenarioError(f"`{key}` finds nothing here; {near_names(key, node)}", where=pattern)
            for name in names:
                node[name] = copy.deepcopy(value)
        elif isinstance(node, list):
            for index in range(len(node)) if key == "*" else [_index(node, key, pattern)]:
                node[index] = copy.deepcopy(value)
        else:
            raise ScenarioError(f"{node!r} has no parts, so no {key!r}", where=pattern)
    return changed


def _index(node: list[Any] | tuple[Any, ...], key: str, pattern: str) -> int:
    if not key.isdecimal() or int(key) >= len(node):
        raise ScenarioError(f"no element {key!r}; allowed: 0 to {len(node) - 1}", where=pattern)
    return int(key)


def _expand(
    node: Any, segments: list[str], pattern: str, *, open_null: bool = False
) -> list[tuple[str, ...]]:
    """Key tuples that match a pattern.

    Args:
        node: Document or a part of it.
        segments: Remaining segments of the pattern.
        pattern: Complete pattern, for error messages.
        open_null: Whether null sections on the path become empty ones, in place.
    """
    if not segments:
        return [()]
    if isinstance(node, list | tuple):
        keys = [(str(i), 1) for i in range(len(node))] if segments[0] == "*" else []
        keys = keys or [(str(_index(node, segments[0], pattern)), 1)]
    elif isinstance(node, dict):
        # keys that match the first segments, each with the number of segments that it takes
        names = [str(key) for key in node]
        hint = f"; {near_names(segments[0], names)}" if node else ""
        if "*" in segments[0]:
            keys = [(key, 1) for key in matching(names, segments[0])]
            if not keys:
                raise ScenarioError(f"`{segments[0]}` finds nothing here{hint}", where=pattern)
        else:
            joined = ((".".join(segments[:used]), used) for used in range(len(segments), 0, -1))
            keys = [next((candidate for candidate in joined if candidate[0] in node), ("", 0))]
            if not keys[0][1]:
                near = near_names(segments[0], names)
                raise ScenarioError(f"no {segments[0]!r}; {near}", where=pattern)
    else:
        raise ScenarioError(f"{node!r} has no parts, so no {segments[0]!r}", where=pattern)
    matches = []
    for key, used in keys:
        child = node[int(key)] if isinstance(node, list | tuple) else node[key]
        if child is None and open_null and isinstance(node, dict):
            child = node[key] = {}
            matches.append((key, *segments[used:]))
            for name in segments[used:]:
                child[name] = {}
                child = child[name]
            continue
        matches += [(key, *rest) for rest in _expand(child, segments[used:], pattern, open_null=open_null)]
    return matches
