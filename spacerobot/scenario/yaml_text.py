"""YAML as scenario files use it: the core schema of YAML 1.2, plain values only, each key once."""

from __future__ import annotations

import re
from typing import Any

import yaml

_CORE = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", list("-+.")),
    ("merge", r"<<", ["<"]),
)
"""What a plain scalar is read as: tag, pattern, first characters.

YAML 1.1, which PyYAML reads by itself, takes ``010`` for 8, ``1:30`` for 90, ``no`` for false and ``1e-3``
for a text.
"""


class Loader(yaml.SafeLoader):
    """Safe loader of the core schema that refuses a key given twice."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own way; filled below)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Mapping whose keys are names, each given once; keys merged in by ``<<`` may be given again."""
        if not isinstance(node, yaml.MappingNode):  # tagged !!map
            message = f"found a {node.id}, which is no mapping"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
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
                    None, None, f"key {key!r} is given twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Value of a node; a tag that does not fit its text, such as ``!!bool maybe``, is refused."""
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, KeyError, IndexError, TypeError, OverflowError):
            kind = node.tag.rpartition(":")[2]
            message = f"found {str(node.value)[:60]!r}, which is no {kind}"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark) from None

    def construct_int(self, node: yaml.ScalarNode) -> int:
        """Whole number in decimal digits, zeros in front or not."""
        return int(self.construct_scalar(node))

    def refuse(self, node: yaml.Node) -> Any:
        """Refuse what is no plain value.

        Raises:
            yaml.constructor.ConstructorError: Always.
        """
        kind = node.tag.rpartition(":")[2]
        message = f"a {kind}, where plain values are allowed; a text may be quoted"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)


class Dumper(yaml.SafeDumper):
    """Dumper without aliases, with lists of plain values on one line and texts of several lines as blocks.

    It puts in quotes what either schema would take for something else than a text.
    """

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the base class fixes the signature)
        """Write everything out."""
        return True

    def represent_plain_list(self, items: list[Any]) -> yaml.SequenceNode:
        """List, on one line if nothing in it is a list or a mapping."""
        flat = all(not isinstance(item, dict | list) for item in items)
        return self.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)

    def represent_text(self, text: str) -> yaml.ScalarNode:
        """Text, line by line if it has several."""
        return self.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


for _tag, _pattern, _first in _CORE:
    for _class in (Loader, Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _first)
Loader.add_constructor("tag:yaml.org,2002:int", Loader.construct_int)
for _kind in ("binary", "timestamp", "set", "omap", "pairs"):
    Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", Loader.refuse)
Dumper.add_representer(list, Dumper.represent_plain_list)
Dumper.add_representer(str, Dumper.represent_text)


def describe(fault: yaml.MarkedYAMLError) -> tuple[str | None, str]:
    """Place and one line for a fault of the YAML itself."""
    mark = fault.problem_mark or fault.context_mark
    where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else None
    message = fault.problem or "not YAML"
    if fault.context:
        begun = fault.context_mark
        place = f" that begins in line {begun.line + 1}" if begun and mark and begun.line != mark.line else ""
        message = f"{message} ({fault.context}{place})"
    if "'\\t'" in message:
        message += "; indent with spaces, not tabs"
    return where, message
