"""Errors that users can correct, with the file, the place, the value and the allowed values.

Every error that invalid input can cause derives from :class:`SpaceRobotError`. The command line prints the
error in one line and exits with :attr:`SpaceRobotError.exit_code`. It catches no other exceptions.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class SpaceRobotError(Exception):
    """Base class of errors caused by input or environment rather than by a defect.

    Args:
        message: Value and allowed values, in one line.
        source: File with the error, if any.
        where: Place in that file: a scenario's dotted path or a URDF element.
    """

    exit_code = 2

    def __init__(self, message: str, *, source: Path | str | None = None, where: str | None = None) -> None:
        self.message = " ".join(message.split())
        self.source = source
        self.where = where
        # escape control characters, with which a malicious file could manipulate the terminal
        visible = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode()
            for c in ": ".join(str(part) for part in (source, where, self.message) if part)
        )
        super().__init__(visible)


class ScenarioError(SpaceRobotError):
    """Scenario that cannot be read or simulated."""


class DescriptionError(SpaceRobotError):
    """URDF that cannot be read or simulated."""


class ResultError(SpaceRobotError):
    """Result that cannot be read, written or shown."""


class SpaceRobotWarning(UserWarning):
    """Warning about the environment, such as an unusable cache, that affects speed but not results."""


class CompileError(SpaceRobotError):
    """Failure to compile or load generated code."""


class DivergedError(SpaceRobotError):
    """Simulation that diverges at once, whose tolerance no step satisfies, or whose grasp does not close."""

    exit_code = 3


class NoPlanError(SpaceRobotError):
    """Planning problem without a feasible solution, or whose solution fails the verification by replay."""

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
"""Keys of earlier versions and their new names, which messages about unknown keys suggest."""


MOST_NAMES, SOME_NAMES = 60, 12
"""Maximum number of names that a message lists completely, and number of names listed otherwise."""


def near_names(name: str, allowed: Iterable[str]) -> str:
    """Hint after an unknown name: its new name, or similar names, or the allowed names.

    Args:
        name: Unknown name.
        allowed: Allowed names.
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
