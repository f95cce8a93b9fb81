"""A phase's changes laid over the scenario, and what may differ at all.

Changes are laid over the scenario before they are validated, so what they hold may have any shape: a number
where a section belongs goes into the merged document as it is, whose validation names its place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from spacerobot.common.errors import near_names
from spacerobot.common.section import is_number, leaves, matching
from spacerobot.elements.core.registry import find_kind
from spacerobot.scenario.paths import Document

CONTROLLERS = ("pid", "orientation_pid", "amnesia", "orientation_amnesia")
"""Controllers of a tip that have keys of their own."""


NAMED = ("robots.", "tips.", "controllers.", "grasps.")
"""Ends of the paths of what stands in a mapping by name."""


def expand_names(changes: Document, base: Document, path: str = "") -> Document:
    """Changes with ``*`` in names replaced by the base's names, a full name winning over a pattern.

    Raises:
        ValueError: Where a name is not in the base; its text begins with the dotted path.
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
    """Whether a section is of another kind than the one that it stands for."""
    return "kind" in value and value["kind"] != old.get("kind")


def overlay(base: Document, changes: Document) -> Document:
    """Base with changes: sections key by key, unless of another kind; everything else replaced."""
    merged = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        merges = isinstance(value, dict) and isinstance(old, dict) and not _replaces(value, old)
        merged[key] = overlay(old, value) if merges else value  # type: ignore[arg-type]
    return merged


def without_resting(document: Document) -> Document:
    """Document whose mappings of named controllers lack those that are null, in place."""
    robots = sections(document.get("robots"))
    for holder in [*robots, *(tip for robot in robots for tip in sections(robot.get("tips")))]:
        if isinstance(holder.get("controllers"), dict):
            holder["controllers"] = without_null(holder["controllers"])
    return document


def sections(node: Any) -> list[Document]:
    """Sections of a mapping by name; none of what is no mapping."""
    return [each for each in node.values() if isinstance(each, dict)] if isinstance(node, dict) else []


def without_null(document: Document) -> Document:
    """Entries of a mapping that are not null."""
    return {name: value for name, value in document.items() if value is not None}


def pick(merged: Document, changes: Document) -> Document:
    """Entries of a merged document that the changes name; references are kept whole."""
    return {
        key: pick(merged[key], value)
        if isinstance(value, dict) and isinstance(merged.get(key), dict) and key != "reference"
        else merged.get(key)  # a named controller that rests is not there
        for key, value in changes.items()
    }


def check_changes(base: Document, changes: Document) -> None:
    """Refuse what cannot differ by phase.

    Raises:
        ValueError: Its text begins with the dotted path.
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
    """Values of a nested document that are no sections, and references whole."""
    for key, value in node.items():
        if isinstance(value, dict) and key != "reference":
            yield from _parts(value, (*path, key))
        else:
            yield (*path, key), value


def _is_controller(path: tuple[str, ...]) -> bool:
    """Whether a path is that of a controller itself."""
    inside = path[4:] if path[2:3] == ("tips",) else path[2:]
    return (inside[0] in (*CONTROLLERS, "joint_pd") and len(inside) == 1) or (
        inside[0] == "controllers" and len(inside) == 2
    )


def _may_rest(changes: Document, path: tuple[str, ...]) -> bool:
    """Whether a controller may be null: an amnesia controller where the PID that it corrects rests too."""
    section: Any = changes
    for key in path[:-1]:
        section = section[key]
    return "amnesia" not in path[-1] or section.get(path[-1].replace("amnesia", "pid"), path) is None


def _words(base: Document, path: tuple[str, ...]) -> tuple[str, ...]:
    """Keys of a tip controller's words that may differ by phase; none of anything else."""
    if not (path[2:3] == ("tips",) and _is_controller(path)):
        return ()
    section: Any = base
    for key in path:
        section = section[key]
    kind = find_kind("tip_controller", section.get("kind", ""))
    by_phase: tuple[str, ...] = getattr(kind, "by_phase", ())
    return by_phase


def _may_differ(path: tuple[str, ...]) -> bool:
    """Whether a number at a path is read while the simulation runs."""
    if path[0] == "grasps":
        return len(path) > 2 and path[2] != "max_gap"
    if path[0] != "robots" or len(path) < 3:
        return False
    inside = path[4:] if path[2] == "tips" else path[2:]
    fails = inside[:1] == ("actuators",) and path[-1] == "at"
    return fails or (bool(inside) and inside[0] in (*CONTROLLERS, "joint_pd", "controllers", "sensors"))
