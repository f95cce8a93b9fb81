"""YAML of scenario files: core schema of YAML 1.2, plain values only, without duplicate keys."""

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
"""Resolution of plain scalars: tag, pattern, first characters.

PyYAML's default, YAML 1.1, reads ``010`` as 8, ``1:30`` as 90, ``no`` as false and ``1e-3`` as a text.
"""


class Loader(yaml.SafeLoader):
    """Safe loader with the core schema, which rejects duplicate keys."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (required by PyYAML; filled below)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Mapping of a node; keys must be unique texts, but may override keys merged by ``<<``."""
        if not isinstance(node, yaml.MappingNode):  # tagged !!map
            message = f"found a {node.id}, which is no mapping"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
        keys: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"keys are names, found {key!r}", key_node.start_mark
                )
            if key in keys:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} is given twice", key_node.start_mark
                )
            keys.add(key)
        return super().construct_mapping(node, deep=deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Value of a node; a text that contradicts its tag, such as ``!!bool maybe``, is an error."""
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, KeyError, IndexError, TypeError, OverflowError):
            kind = node.tag.rpartition(":")[2]
            message = f"found {str(node.value)[:60]!r}, which is no {kind}"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark) from None

    def construct_int(self, node: yaml.ScalarNode) -> int:
        """Integer of decimal digits, with or without leading zeros."""
        return int(self.construct_scalar(node))

    def refuse(self, node: yaml.Node) -> Any:
        """Reject a value that is not plain, such as a timestamp.

        Raises:
            yaml.constructor.ConstructorError: Always.
        """
        kind = node.tag.rpartition(":")[2]
        message = f"a {kind}, where plain values are allowed; a text may be quoted"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)


class Dumper(yaml.SafeDumper):
    """Dumper without aliases, with lists of plain values on one line and multi-line texts as blocks.

    Texts that YAML 1.1 or the core schema would read as another type are quoted.
    """

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the base class fixes the signature)
        """Whether to write a value in full instead of an alias: always."""
        return True

    def represent_plain_list(self, items: list[Any]) -> yaml.SequenceNode:
        """Node of a list, on one line if it contains no lists or mappings."""
        flat = all(not isinstance(item, dict | list) for item in items)
        return self.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)

    def represent_text(self, text: str) -> yaml.ScalarNode:
        """Node of a text, as a block if it has several lines."""
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
    """Place and message of a YAML syntax error."""
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
