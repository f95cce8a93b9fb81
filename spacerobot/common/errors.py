"""Errors a user can act on: what was found, where, and what is allowed.

Every error that bad input can cause derives from :class:`SpaceRobotError`. The command line prints
its one line and exits with :attr:`SpaceRobotError.exit_code`; nothing else is caught.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class SpaceRobotError(Exception):
    """Base of every error caused by input or surroundings rather than by a defect.

    Args:
        message: What was found and what is allowed, in one line.
        source: File that holds the fault, if one does.
        where: Place in that file: a scenario's dotted path or a URDF element.
    """

    exit_code = 2

    def __init__(self, message: str, *, source: Path | str | None = None, where: str | None = None) -> None:
        self.message = " ".join(message.split())
        self.source = source
        self.where = where
        # text whose control characters, which a file may hold to fool a terminal, are written out
        visible = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode()
            for c in ": ".join(str(part) for part in (source, where, self.message) if part)
        )
        super().__init__(visible)


class ScenarioError(SpaceRobotError):
    """A scenario that cannot be read or does not describe something that can be simulated."""


class DescriptionError(SpaceRobotError):
    """A URDF that cannot be read or holds something that cannot be simulated."""


class ResultError(SpaceRobotError):
    """A result folder that cannot be read or written."""


class SpaceRobotWarning(UserWarning):
    """Surroundings that slow a job down but change no result; the command line prints its one line."""


class CompileError(SpaceRobotError):
    """Generated code that could not be compiled or loaded."""


class DivergedError(SpaceRobotError):
    """A rollout that left its stability limit; raised only on the caller's request."""

    exit_code = 3


class NoPlanError(SpaceRobotError):
    """No motion that meets its goal and its limits was found, or none that holds when it is replayed."""

    exit_code = 4


FORMER_NAMES = {
    "at_most": "timeout",
    "then": "next",
    "otherwise": "on_timeout",
    "least": "min_horizon",
    "rival_budget": "baseline_budget",
    "readings": "variants",
    "most_intervals": "max_intervals",
    "last": "final_fraction",
    "cones": "approach_cones",
    "sights": "line_of_sight",
    "shape": "kind",
}
"""Keys of earlier versions and those that replaced them; an unknown key gets its new name in the message."""


MOST_NAMES, SOME_NAMES = 60, 12
"""Number of names up to which a message lists all, and number that it lists otherwise."""


def near_names(name: str, allowed: Iterable[str]) -> str:
    """Sentence that helps after a wrong name: its new name, else near ones, else all, or some of very many.

    Args:
        name: What was found.
        allowed: What would have been valid.
    """
    names = sorted(allowed)
    if FORMER_NAMES.get(name) in names:
        return f"use {FORMER_NAMES[name]!r}"
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.6)
    if close:
        return "did you mean " + " or ".join(close) + "?"
    if not names:
        return "there are none"
    if len(names) > MOST_NAMES:
        return f"allowed: {len(names)} names, among them {', '.join(names[:SOME_NAMES])}"
    return f"allowed: {', '.join(names)}"
