"""Syntax trees of the product's modules, for tests of its architecture and its words."""

import ast
import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def parsed(path: Path) -> ast.Module:
    """Syntax tree of a file; every test of a process sees the same one.

    All trees have 600 000 nodes, which no later collection of garbage looks through.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    gc.freeze()
    return tree


def parsed_modules(*packages: str) -> Iterator[tuple[str, ast.Module]]:
    """Syntax trees of all modules of packages, by their paths."""
    for package in packages:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), parsed(path)
