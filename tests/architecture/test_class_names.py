"""No two classes of the product share a name."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("spacerobot", "optim", "viz", "benchmarks")


def test_no_two_classes_share_a_name():
    found = defaultdict(set)
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    found[node.name].add(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert len(found) > 400
    assert not {name: sorted(places) for name, places in found.items() if len(places) > 1}
