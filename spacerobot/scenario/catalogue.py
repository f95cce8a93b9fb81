"""Shipped scenarios by name."""

from __future__ import annotations

from pathlib import Path

from spacerobot.common.errors import ScenarioError, near_names

FOLDER = Path(__file__).parent.parent / "scenarios"


def shipped() -> dict[str, Path]:
    """Files of the shipped scenarios by name, in alphabetical order."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


def find_scenario(name: str) -> Path:
    """File of a scenario, from a path or the name of a shipped scenario.

    Raises:
        ScenarioError: If there is neither.
    """
    path = Path(name).expanduser()
    try:
        if path.is_file():
            return path.resolve()
    except (OSError, ValueError):
        raise ScenarioError("not a file name", source=name[:80]) from None
    if name in shipped():
        return shipped()[name]
    if path.suffix in {".yaml", ".yml"}:
        raise ScenarioError("no such file", source=name)
    raise ScenarioError(f"no such file, nor a shipped scenario; {near_names(name, shipped())}", source=name)
