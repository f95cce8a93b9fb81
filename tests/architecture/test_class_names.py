"""No two classes of the product share a name."""

import ast
from collections import defaultdict

from tests.oracles.syntax_trees import parsed_modules

PACKAGES = ("spacerobot", "optim", "viz", "benchmarks")


def test_no_two_classes_share_a_name():
    found = defaultdict(set)
    for path, tree in parsed_modules(*PACKAGES):
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                found[node.name].add(f"{path}:{node.lineno}")
    assert len(found) > 400
    assert not {name: sorted(places) for name, places in found.items() if len(places) > 1}
