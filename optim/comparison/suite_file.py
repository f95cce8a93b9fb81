"""Content of ``suite.yaml``, read without the libraries that solve its problems."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources
from typing import Any

from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.scenario.document import parse_yaml


def read_suite() -> dict[str, Any]:
    """The suite as plain data: effort, methods, scenes, variables and problems."""
    text = resources.files("optim.comparison").joinpath("suite.yaml").read_text(encoding="utf-8")
    suite: dict[str, Any] = parse_yaml(text, source="suite.yaml")
    return suite


def check_problems(names: Iterable[str]) -> None:
    """Check names of the suite's problems.

    Raises:
        SpaceRobotError: If there is no such problem.
    """
    problems = read_suite()["problems"]
    for name in names:
        if name not in problems:
            raise SpaceRobotError(f"no problem {name!r} in the suite; {near_names(name, problems)}")
