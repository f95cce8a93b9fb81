"""Merge of a phase's changes with the scenario, and checks of what may differ between phases.

Changes are merged before they are validated, so that their values may have any type: a number in place of a
section is copied to the merged document, whose validation reports its path.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from spacerobot.common.errors import near_names
from spacerobot.common.section import is_number, leaves, matching
from spacerobot.elements.core.registry import find_kind
from spacerobot.scenario.paths import Document

CONTROLLERS = ("pid", "orientation_pid", "amnesia", "orientation_amnesia")
"""Keys of a tip's section that are controllers."""


NAMED = ("robots.", "tips.", "controllers.", "grasps.")
"""Last parts of the paths of mappings by name."""


def expand_names(changes: Document, base: Document, path: str = "") -> Document:
    """Changes with patterns (``*``) replaced by the names of the base; full names override patterns.

    Args:
        changes: Changes, nested as in the base.
        base: Document with the names.
        path: Dotted path of the changes, with a dot at its end, for error messages.

    Raises:
        ValueError: If a name is not in the base; the message begins with the dotted path.
    """
    expanded: Document = {}
    for pattern in sorted(changes, key=lambda name: "*" not in name):  # stable: full names last
        names = matching(base, pattern) if "*" in pattern else [pattern]
        if not names or (path.endswith(NAMED) and names[0] not in base):
            raise ValueError(f"{path}{pattern}: finds nothing in the scenario; {near_names(pattern, base)}")
        for name in names:
            value, inside = changes[pattern], base.get(name)
            if isinstance(value, dict) and isinstance(inside, dict) and not _replaces(value, inside):
                value = expand_names(value, inside, f"{path}{name}.")
            old = expanded.get(name)
            expanded[name] = (
                overlay(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
            )
    return expanded


def _replaces(value: Mapping[str, Any], old: Mapping[str, Any]) -> bool:
    """Whether a section has another kind than the old one, and therefore replaces it entirely."""
    return "kind" in value and value["kind"] != old.get("kind")


def overlay(base: Document, changes: Document) -> Document:
    """Document with changes: sections of the same kind are merged key by key, other values are replaced."""
    merged = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        merges = isinstance(value, dict) and isinstance(old, dict) and not _replaces(value, old)
        merged[key] = overlay(old, value) if merges else value  # type: ignore[arg-type]
    return merged


def without_disabled(document: Document) -> Document:
    """Remove null entries, which disable controllers, from the mappings of named controllers, in place."""
    robots = sections(document.get("robots"))
    for holder in [*robots, *(tip for robot in robots for tip in sections(robot.get("tips")))]:
        if isinstance(holder.get("controllers"), dict):
            holder["controllers"] = without_null(holder["controllers"])
    return document


def sections(node: Any) -> list[Document]:
    """Sections in a mapping by name; none if the value is not a mapping."""
    return [each for each in node.values() if isinstance(each, dict)] if isinstance(node, dict) else []


def without_null(document: Document) -> Document:
    """Entries of a mapping that are not null."""
    return {name: value for name, value in document.items() if value is not None}


def pick(merged: Document, changes: Document) -> Document:
    """Entries of a merged document that the changes name, with complete references."""
    return {
        key: pick(merged[key], value)
        if isinstance(value, dict) and isinstance(merged.get(key), dict) and key != "reference"
        else merged.get(key)  # a disabled controller is missing in the merged document
        for key, value in changes.items()
    }


def check_changes(base: Document, changes: Document) -> None:
    """Check that a phase changes only what may differ between phases.

    Raises:
        ValueError: If it changes something else; the message begins with the dotted path.
    """
    for path, value in _parts(changes, ()):
        where, old = ".".join(path), base
        for key in path:
            old = old.get(key) if isinstance(old, dict) else None  # type: ignore[assignment]
        if old == value or path[-1] == "reference":
            continue
        if not _may_differ(path):
            raise ValueError(
                f"{where}: is the same in every phase; allowed to differ: references, numbers of "
                "controllers, sensors and grasps, times `at` of failures, and null for a controller that "
                "rests"
            )
        if value is None and _is_controller(path) and _may_rest(changes, path):
            continue
        if isinstance(value, str) and path[-1] in _words(base, path[:-1]):
            continue
        same = [place for place, _ in leaves(value)] == [place for place, _ in leaves(old)]
        if old is None or not same or not all(is_number(x) for both in (value, old) for _, x in leaves(both)):
            message = (
                "the scenario has none: give it there" if old is None else "only a number may differ by phase"
            )
            hint = "; write `ge: 0`" if value is None and "amnesia" in path[-1] else ""
            raise ValueError(f"{where}: {message}{hint}")


def _parts(node: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Iterate over the paths and values of a nested document; a reference is a single value."""
    for key, value in node.items():
        if isinstance(value, dict) and key != "reference":
            yield from _parts(value, (*path, key))
        else:
            yield (*path, key), value


def _is_controller(path: tuple[str, ...]) -> bool:
    """Whether a path is that of a controller, not of one of its keys."""
    inside = path[4:] if path[2:3] == ("tips",) else path[2:]
    return (inside[0] in (*CONTROLLERS, "joint_pd") and len(inside) == 1) or (
        inside[0] == "controllers" and len(inside) == 2
    )


def _may_rest(changes: Document, path: tuple[str, ...]) -> bool:
    """Whether a controller may be null: an amnesia controller only together with the PID that it corrects."""
    section: Any = changes
    for key in path[:-1]:
        section = section[key]
    return "amnesia" not in path[-1] or section.get(path[-1].replace("amnesia", "pid"), path) is None


def _words(base: Document, path: tuple[str, ...]) -> tuple[str, ...]:
    """Keys with words of a tip controller that may differ between phases; none for other sections."""
    if not (path[2:3] == ("tips",) and _is_controller(path)):
        return ()
    section: Any = base
    for key in path:
        section = section[key]
    kind = find_kind("tip_controller", section.get("kind", ""))
    by_phase: tuple[str, ...] = getattr(kind, "by_phase", ())
    return by_phase


def _may_differ(path: tuple[str, ...]) -> bool:
    """Whether a number at a path may differ between phases: it is used during the simulation."""
    if path[0] == "grasps":
        return len(path) > 2 and path[2] != "max_gap"
    if path[0] != "robots" or len(path) < 3:
        return False
    inside = path[4:] if path[2] == "tips" else path[2:]
    fails = inside[:1] == ("actuators",) and path[-1] == "at"
    return fails or (bool(inside) and inside[0] in (*CONTROLLERS, "joint_pd", "controllers", "sensors"))
