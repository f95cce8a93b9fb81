"""Scenario text with changed values, in which everything else stays as written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import yaml

from spacerobot.scenario.yaml_text import Loader

PLAIN = re.compile(r"[A-Za-z_]\w*")
"""Texts that need no quotes, those of ``WORDS`` aside."""

WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")


def edited(text: str, changes: Mapping[str, Any]) -> str | None:
    """Text with values set at dotted paths; None if one cannot be set without rewriting more.

    Existing values are replaced. New ones are inserted at the start of their section, or at the end of a
    section in braces. With shared YAML anchors the edit may change more than intended: compare after reading
    it again.
    """
    for path, value in changes.items():
        try:
            node: Any = yaml.compose(text, Loader=Loader)
        except yaml.YAMLError:
            return None
        keys = path.split(".")
        while keys:
            child, key = None, keys[0]
            if isinstance(node, yaml.MappingNode):
                child = next((child for name, child in node.value if name.value == key), None)
            elif isinstance(node, yaml.SequenceNode) and key.isdecimal() and int(key) < len(node.value):
                child = node.value[int(key)]
            if child is None:
                break
            node, keys = child, keys[1:]
        begin, end = node.start_mark.index, node.end_mark.index
        if keys:
            # a new key in a mapping, with nested sections
            if not isinstance(node, yaml.MappingNode) or not (node.flow_style or node.value):
                return None
            for key in reversed(keys[1:]):
                value = {key: value}
            entry = f"{flow(keys[0])}: {flow(value)}"
            if node.flow_style:
                text = f"{text[: end - 1]}{', ' if node.value else ''}{entry}{text[end - 1 :]}"
            else:
                first = node.value[0][0].start_mark
                text = f"{text[: first.index]}{entry}\n{' ' * first.column}{text[first.index :]}"
            continue
        if begin == end or text[begin] in "*&":
            return None
        if isinstance(node, yaml.CollectionNode):
            end = len(text[:end].rstrip())
        text = text[:begin] + flow(value) + text[end:]
    return text


def flow(value: Any) -> str:
    """A value on one line of YAML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{flow(key)}: {flow(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    if isinstance(value, str) and PLAIN.fullmatch(value) and value.lower() not in WORDS:
        return value
    return json.dumps(value, ensure_ascii=False)
