"""Scenario files: YAML read safely, validated, and every fault told in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from spacerobot.elements import kinds
from spacerobot.errors import ScenarioError
from spacerobot.quantities import planned
from spacerobot.scenario.paths import Document
from spacerobot.scenario.scenario import Scenario
from spacerobot.scenario.validation_errors import explain
from spacerobot.scenario.yaml_text import Dumper, Loader, describe

MAX_BYTES = 5_000_000
MAX_NODES = 500_000
MAX_DEPTH = 100


def read_document(path: Path) -> Document:
    """Plain content of a YAML file, not validated yet.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not YAML or is not a mapping.
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
    document = parse_yaml(text, source=path)
    if not isinstance(document, dict):
        raise ScenarioError(
            f"a scenario is a mapping of keys to values, found {type(document).__name__}", source=path
        )
    return document


def parse_yaml(text: str, *, source: Path | str | None = None) -> Any:
    """Value of a YAML text.

    Raises
    ------
    ScenarioError
        If it is not YAML, or unfolds to more than is sane.
    """
    loader = None
    try:
        loader = Loader(text)
        node = loader.get_single_node()
        # measured before aliases and merge keys are unfolded, which takes time and memory without bound
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
    """Count of values with aliases and merge keys unfolded, and levels of nesting.

    A node that holds itself counts infinitely many.

    Parameters
    ----------
    node
        Root of the composed graph, in which an alias is the node of its anchor.
    measured
        Results of the nodes that were visited, by their identity.
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


def validate(document: Document, *, source: Path | str | None = None) -> Scenario:
    """Scenario of a document.

    Raises
    ------
    ScenarioError
        For the first fault found: its dotted path, what was found and what is allowed.
    """
    try:
        return Scenario.model_validate(document)
    except ValidationError as fault:
        errors = fault.errors(include_url=False)
        where, message = explain(errors[0], document)
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise ScenarioError(message + more, source=source, where=where or None) from None
    except RecursionError:
        raise ScenarioError("nested too deeply", source=source) from None


def to_document(scenario: Scenario) -> Document:
    """Plain form of a scenario, defaults included, as YAML and dotted paths see it."""
    return scenario.model_dump(mode="json")


def to_yaml(scenario: Scenario) -> str:
    """YAML text that reads back to the same scenario; what is null is left out."""
    return yaml.dump(to_document(scenario), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=110)


def json_schema() -> dict[str, Any]:
    """JSON schema of scenario files, for editors."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    schema = {"$schema": dialect, **Scenario.model_json_schema(), "title": "spacerobot scenario"}
    for section in schema["$defs"].values():
        paths = section["properties"].get("paths")
        if paths is not None:  # one path may stand without a list around it
            several = {key: paths.pop(key) for key in ("type", "items", "minItems") if key in paths}
            paths["anyOf"] = [{"type": "string"}, several]
    duration = schema["$defs"]["PlanSection"]["properties"]["duration"]  # a number is a time that is given
    duration["anyOf"] = [{"type": "number", "exclusiveMinimum": 0}, {"$ref": duration.pop("$ref")}]
    definitions = schema["$defs"]
    options: dict[str, dict[str, list[Any]]] = {"costs": {}, "limits": {}}
    for name, weighed in planned().items():
        unit, text = weighed.weight_unit(), f"weight: {weighed.description}"
        number = {"type": "number", "description": f"{text} [{unit}]", "unit": unit, "minimum": 0}
        options["costs"][name] = [number, {"$ref": "#/$defs/PlanCost"}]
    for name, kind in kinds("plan_limit").items():
        place, short = f"#/$defs/{kind.__name__}", getattr(kind, "short", None)
        alone = [definitions[kind.__name__]["properties"][short]] if short else []
        options["limits"][name] = [*alone, {"$ref": place}]
    for key, named in options.items():  # under the name of a kind, a number or list alone
        entries = definitions["PlanSection"]["properties"][key]
        (section,) = entries.pop("patternProperties").values()
        entries["additionalProperties"] = section
        entries["properties"] = {name: {"anyOf": [*each, {"type": "null"}]} for name, each in named.items()}
    return schema
