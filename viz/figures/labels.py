"""Labels of results, and the numbers in which their scenarios differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spacerobot.result import Result
from spacerobot.scenario.load import to_document

NAMED = 2
"""Differing values in a label, at most."""
LONGEST = 40
"""Letters of a label that is made of differing values, at most."""
LONGEST_VALUE = 60
"""Letters of a list that is shown whole, at most."""


def labels_of(results: Sequence[Result]) -> list[str]:
    """Short names that tell results apart.

    A single result has the name of its scenario. Several have the names of their folders, else of their
    scenarios; equal names are replaced by the values in which the scenarios differ, if these are few, and
    numbered otherwise.
    """
    if len(results) == 1:
        return [results[0].scenario.name]
    names = [result.folder.resolve().name if result.folder else result.scenario.name for result in results]
    if len(set(names)) == len(names):
        return names
    differing = differences([to_document(result.scenario) for result in results])
    # a link's inertia is scaled with its mass when that is changed
    masses = {path.removesuffix("mass") for path, _ in differing if path.endswith(".mass")}
    scaled = {link + key for link in masses for key in ("inertia", "inertia_at_mass")}
    differing = [(path, texts) for path, texts in differing if path not in scaled]
    if len(set(names)) == 1 and len(differing) <= NAMED:
        # the last keys of a path say which number it is, unless another one ends likewise
        ends = [".".join(path.split(".")[-2:]) for path, _ in differing]
        labels = [
            ", ".join(f"{end} = {texts[k]}" for end, (_, texts) in zip(ends, differing, strict=True))
            for k in range(len(names))
        ]
        differ = len(set(ends)) == len(ends) and len(set(labels)) == len(labels)
        if differ and max(map(len, labels)) <= LONGEST:
            return labels
    return [f"{name} ({k})" for k, name in enumerate(names, start=1)]


def differences(documents: Sequence[Any]) -> list[tuple[str, list[str]]]:
    """Dotted paths at which documents differ, with the value of each as text."""
    flat = [dict(_leaves(document, "")) for document in documents]
    paths = list(dict.fromkeys(path for leaves in flat for path in leaves))
    rows = []
    for path in paths:
        # numbers in no more digits than tell them apart for a reader
        values = [leaves.get(path, "-") for leaves in flat]
        texts = ["none" if v is None else f"{v:.10g}" if isinstance(v, float) else str(v) for v in values]
        if len(set(texts)) > 1:
            rows.append((path, [_shortened(text) for text in texts]))
    return rows


def _shortened(text: str) -> str:
    """Text of a value; of a long list, such as the knots of a plan, its beginning and its size."""
    if len(text) <= LONGEST_VALUE or not text.startswith("["):
        return text
    beginning = text[: text.rindex(",", 0, LONGEST_VALUE)]
    return f"{beginning}, ... ({text.count(',') + 1} values)"


def _leaves(node: Any, path: str) -> list[tuple[str, Any]]:
    if isinstance(node, dict):
        leaves: list[tuple[str, Any]] = []
        for key, value in node.items():
            leaves += _leaves(value, f"{path}.{key}" if path else key)
        return leaves
    return [(path, node)]
