"""Safe reading of scenario files to plain documents, which are not validated.

The module imports no section of a scenario, so that a missing file or invalid YAML is reported quickly.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.yaml_text import Loader, describe

if TYPE_CHECKING:
    from spacerobot.scenario.paths import Document

MAX_BYTES = 5_000_000
MAX_NODES = 500_000
MAX_DEPTH = 100


def read_document(path: Path) -> Document:
    """Read a YAML file to a plain document.

    Raises:
        ScenarioError: If the file cannot be read, is not YAML or is not a mapping.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ScenarioError(f"larger than {MAX_BYTES // 1_000_000} MB, so not a scenario", source=path)
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError("no such file", source=path) from None
    except UnicodeDecodeError as fault:
        raise ScenarioError(f"not UTF-8 text: byte {fault.start} cannot be read", source=path) from None
    except OSError as fault:
        raise ScenarioError(f"cannot be read: {fault.strerror}", source=path) from None
    if text.lstrip().startswith("<"):
        message = "is XML, not a scenario; `spacerobot new --robot FILE` drafts a scenario from a URDF"
        raise ScenarioError(message, source=path)
    document = parse_yaml(text, source=path)
    if not isinstance(document, dict):
        raise ScenarioError(
            f"a scenario is a mapping of keys to values, found {type(document).__name__}", source=path
        )
    return document


MISSING_SECTIONS = {
    "plan": "no such section: it defines the planning problem (docs/how_to/plan_and_follow.md)",
    "campaign": "no campaign section, which defines the uncertain parameters (docs/how_to/monte_carlo.md); "
    "`spacerobot new` writes a scenario that has one",
    "tuning": "this scenario has no tuning section; name what varies by "
    "`spacerobot tune --vary kp=20..2000`, or let `spacerobot new` write a scenario that has one "
    "(docs/explanation/tuning_methods.md)",
}
"""Messages for a scenario without a section, by the section's name."""


def check_section(path: Path, section: str, changes: Iterable[tuple[str, Any]] = ()) -> None:
    """Check that a scenario file has a section, or that a change may add one.

    Args:
        path: File of the scenario.
        section: One of :data:`MISSING_SECTIONS`.
        changes: Dotted paths and values.

    Raises:
        ScenarioError: If there is no section, or as :func:`read_document`.
    """
    may_come = any(pattern.partition(".")[0] in (section, "*") for pattern, _ in changes)
    if not may_come and read_document(path).get(section) is None:
        raise ScenarioError(MISSING_SECTIONS[section], source=path, where=section)


def parse_yaml(text: str, *, source: Path | str | None = None) -> Any:
    """Value of a YAML text.

    Raises:
        ScenarioError: If the text is not YAML, or its aliases expand beyond :data:`MAX_NODES` or
            :data:`MAX_DEPTH`.
    """
    loader = None
    try:
        loader = Loader(text)
        node = loader.get_single_node()
        # measured before aliases and merge keys are expanded, which could take unbounded time and memory
        weight, depth = (0, 0) if node is None else _measure(node, {})
        if depth > MAX_DEPTH:
            raise ScenarioError(
                f"nested too deeply: found {depth} levels, allowed: {MAX_DEPTH}", source=source
            )
        if weight > MAX_NODES:
            raise ScenarioError(f"unfolds to more than {MAX_NODES} values", source=source)
        return None if node is None else loader.construct_document(node)
    except yaml.MarkedYAMLError as fault:
        where, message = describe(fault)
        raise ScenarioError(message, source=source, where=where) from None
    except RecursionError:
        raise ScenarioError("nested too deeply", source=source) from None
    except (yaml.YAMLError, ValueError) as fault:
        raise ScenarioError(f"not YAML: {fault}", source=source) from None
    finally:
        if loader is not None:
            loader.dispose()


def _measure(node: yaml.Node, measured: dict[int, tuple[float, int]]) -> tuple[float, int]:
    """Number of values after expansion of aliases and merge keys, and depth of nesting.

    The number is infinite for a node that contains itself.

    Args:
        node: Root of the composed graph, in which an alias is the node of its anchor.
        measured: Results of visited nodes by their ``id``.
    """
    if isinstance(node, yaml.ScalarNode):
        return 1, 0
    if id(node) not in measured:
        measured[id(node)] = float("inf"), 0
        children = node.value
        if isinstance(node, yaml.MappingNode):
            children = [value for _, value in node.value]
            children += [key for key, _ in node.value if not isinstance(key, yaml.ScalarNode)]
        sizes = [_measure(child, measured) for child in children]
        weight = 1 + sum(weight for weight, _ in sizes)
        measured[id(node)] = weight, 1 + max((depth for _, depth in sizes), default=0)
    return measured[id(node)]
