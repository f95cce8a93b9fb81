"""Arguments and options that several commands share."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spacerobot.common.errors import SpaceRobotError

if TYPE_CHECKING:
    from spacerobot.scene import Scene


@contextmanager
def reported_at(option: str) -> Iterator[None]:
    """Report errors in the block at an option, instead of a place in a file."""
    try:
        yield
    except SpaceRobotError as error:
        raise type(error)(error.message, where=option) from None


@contextmanager
def arguments_as_options(*names: str) -> Iterator[None]:
    """Report errors at arguments of Python functions at the options of the same names."""
    try:
        yield
    except SpaceRobotError as error:
        if error.where not in names:
            raise
        raise type(error)(error.message, source=error.source, where=f"--{error.where}") from None


def parse_changes(texts: list[str] | None) -> list[tuple[str, Any]]:
    """Parse texts ``path=value`` to pairs of dotted path and value.

    Raises:
        ScenarioError: If a text has no ``=``, or its value is not YAML.
    """
    from spacerobot.common.errors import ScenarioError
    from spacerobot.scenario.document import parse_yaml

    changes = []
    for text in texts or []:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise ScenarioError(f"found {text!r}, allowed: PATH=VALUE", where="--set")
        changes.append((path.strip(), parse_yaml(value, source=f"--set {path.strip()}")))
    return changes


@contextmanager
def changes_named(scenario: str, texts: list[str] | None) -> Iterator[None]:
    """Report errors in the block that changes of a scenario cause at the options ``--set``.

    Args:
        scenario: File or name of the scenario.
        texts: Texts ``path=value``.
    """
    from spacerobot.common.errors import ScenarioError
    from spacerobot.common.section import matching

    try:
        yield
    except ScenarioError as error:
        place = (error.where or "").removeprefix("change ")
        unknown = re.match(r"unknown key '([^']*)'", error.message)
        place = f"{place}.{unknown[1]}".lstrip(".") if unknown else place
        paths = {text: text.partition("=")[0].strip() for text in texts or []}
        inside = [text for text, path in paths.items() if matching([place], path)]
        inside += [text for text, path in paths.items() if matching([place], f"{path}.*")]
        around = [text for text, path in paths.items() if not place or path.startswith(f"{place}.")]
        if not (inside or around) or not _is_valid(scenario):
            raise
        if inside:
            raise ScenarioError(error.message, where=f"--set {inside[-1]}") from None
        message = f"{error.message}; with {', '.join(f'--set {text}' for text in around)}"
        raise ScenarioError(message, source=error.source, where=error.where) from None


def _is_valid(scenario: str) -> bool:
    """Whether a scenario is valid without changes."""
    from spacerobot.scene.load import read_scenario

    try:
        read_scenario(scenario)
    except SpaceRobotError:
        return False
    return True


def readable_changes(texts: list[str] | None) -> list[str] | None:
    """Check that texts ``path=value`` can be parsed, before a command imports packages.

    Raises:
        ScenarioError: As :func:`parse_changes`.
    """
    parse_changes(texts)
    return texts


def existing_scenario(name: str) -> str:
    """Check that a scenario exists, before a command imports packages.

    Raises:
        ScenarioError: If the name is neither a file nor a shipped scenario.
    """
    from spacerobot.scenario.catalogue import find_scenario

    find_scenario(name)
    return name


def existing_quantity(name: str | None) -> str | None:
    """Check that a quantity is registered, before a command reads the scenario.

    Raises:
        SpaceRobotError: If there is no such quantity.
    """
    if name is not None:
        from spacerobot.quantities import find_quantity

        with reported_at("--metric"):
            find_quantity(name)
    return name


def valid_address(address: str | None) -> str | None:
    """Check the form of the address of a Dask cluster, before a command writes a folder.

    Raises:
        SpaceRobotError: If it is neither ``local:N``, nor a URL, nor a scheduler file.
    """
    if address is not None:
        from optim.workers.cluster import check_address

        check_address(address)
    return address


def load(scenario: str, changes: list[str] | None, *sections: str) -> Scene:
    """Scene of a scenario with changes; a missing section is reported before anything is loaded.

    Args:
        scenario: File or name of the scenario.
        changes: Texts ``path=value``.
        sections: Sections that the command needs, such as ``campaign``.

    Raises:
        ScenarioError: As :func:`spacerobot.load_scene`, or if a section is missing.
    """
    import spacerobot as sr
    from spacerobot.scenario.catalogue import find_scenario
    from spacerobot.scenario.document import check_section

    pairs = parse_changes(changes)
    for section in sections:
        check_section(find_scenario(scenario), section, pairs)
    with changes_named(scenario, changes):
        return sr.load_scene(scenario, pairs)


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A YAML file, or the name of a shipped scenario.",
        callback=existing_scenario,
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        callback=readable_changes,
        help="Change a value by its dotted path; `*` matches every name. Repeatable. "
        "Example: --set 'grasps.*.stiffness=200'",
    ),
]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for the result; created if missing.")
]
Threads = Annotated[
    int | None,
    typer.Option("--threads", min=1, metavar="N", help="Number of threads; results do not depend on it."),
]
Machines = Annotated[
    str | None,
    typer.Option(
        "--dask",
        metavar="WHERE",
        callback=valid_address,
        help="Run on Dask: local:N, tcp://HOST:PORT, or a scheduler file. Results do not depend on it.",
    ),
]
View = Annotated[bool, typer.Option("--view", help="Then play it in the browser until Ctrl-C.")]
Port = Annotated[
    int,
    typer.Option(
        "--port", metavar="PORT", min=0, max=65535, help="First port to try; busy ports are skipped."
    ),
]
