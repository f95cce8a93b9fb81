"""Scenario files: YAML read safely, validated, and every fault told in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from spacerobot.errors import ScenarioError
from spacerobot.scenario.paths import Document
from spacerobot.scenario.scenario import Scenario

GRASP_KINDS = ("compliant", "point", "weld")
REFERENCE_KINDS = ("circle", "line", "spline", "hold")
MAX_BYTES = 5_000_000
MAX_NODES = 500_000


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses a key given twice and reads ``1e-3`` as a number."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"keys are names, found {key!r}", key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


def _refuse(loader: _Loader, node: yaml.Node) -> Any:  # noqa: ARG001 (YAML calls it so)
    kind = node.tag.rpartition(":")[2]
    raise yaml.constructor.ConstructorError(
        None, None, f"a {kind}, where plain values are allowed; a text may stand in quotes", node.start_mark
    )


for _kind in ("binary", "timestamp", "set", "omap", "pairs"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _refuse)


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
    try:
        value = yaml.load(text, Loader=_Loader)  # noqa: S506 (a SafeLoader)
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else None
        raise ScenarioError(fault.problem or "not YAML", source=source, where=where) from None
    except (yaml.YAMLError, RecursionError, ValueError) as fault:
        raise ScenarioError(f"not YAML: {fault or type(fault).__name__}", source=source) from None
    if _weight(value, {}) > MAX_NODES:
        raise ScenarioError(f"unfolds to more than {MAX_NODES} values", source=source)
    return value


def _weight(value: Any, known: dict[int, float]) -> float:
    """Count of values once aliases are unfolded; infinite for one that holds itself."""
    if not isinstance(value, dict | list):
        return 1
    if id(value) not in known:
        known[id(value)] = float("inf")
        children = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_weight(child, known) for child in children)
    return known[id(value)]


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
        where, message = _explain(errors[0], document)
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise ScenarioError(message + more, source=source, where=where or None) from None
    except RecursionError:
        raise ScenarioError("nested too deeply", source=source) from None


def _explain(error: Any, document: Document) -> tuple[str, str]:
    """Dotted path and one line for one of pydantic's errors."""
    path: list[str] = []
    node: Any = document
    for key in error["loc"]:
        # pydantic puts a union's tag into the location; the document does not hold it
        if isinstance(node, dict) and key not in node and key == node.get("kind", "circle"):
            continue
        if key == "[key]":
            continue
        path.append(str(key))
        node = node.get(key) if isinstance(node, dict) else _element(node, key)
    message = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "missing":
        message = "missing"
    elif error["type"].startswith("union_tag"):
        kinds = ", ".join(REFERENCE_KINDS if path[-1] == "reference" else GRASP_KINDS)
        found = _short(error["input"].get("kind")) if isinstance(error["input"], dict) else "nothing"
        path, message = [*path, "kind"], f"found {found}, allowed: {kinds}"
    elif error["type"] != "value_error":
        message = f"{message[:1].lower()}{message[1:]}, found {_short(error['input'])}"
    return ".".join(path), message


def _element(node: Any, key: Any) -> Any:
    inside = isinstance(node, list | tuple) and isinstance(key, int) and key < len(node)
    return node[key] if inside else None


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def to_document(scenario: Scenario) -> Document:
    """Plain form of a scenario, defaults included, as YAML and dotted paths see it."""
    return scenario.model_dump(mode="json")


def to_yaml(scenario: Scenario) -> str:
    """YAML text that reads back to the same scenario; what is null is left out."""
    return yaml.dump(to_document(scenario), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


class _Dumper(yaml.SafeDumper):
    """Dumper without aliases, with lists of plain values on one line."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the base class fixes the signature)
        return True


def _represent_list(dumper: _Dumper, items: list[Any]) -> yaml.SequenceNode:
    flat = all(not isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)


_Dumper.add_representer(list, _represent_list)


def json_schema() -> dict[str, Any]:
    """JSON schema of scenario files, for editors."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **Scenario.model_json_schema(), "title": "spacerobot scenario"}
