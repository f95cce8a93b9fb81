"""Nothing but its own file and the registry knows a kind: others ask an element for what it can do."""

import ast

import pytest

from spacerobot.elements.core.registry import FAMILIES, PLANS, kinds
from tests.oracles.syntax_trees import parsed_modules

KINDS = {
    kind.__name__: kind
    for family in FAMILIES | PLANS
    for kind in kinds(family).values()
    if kind.__module__.startswith("spacerobot.")
}
MODULES = {kind.__module__ for kind in KINDS.values()}
NAMES = {name for family in FAMILIES | PLANS for name in kinds(family)}
TESTS = {"isinstance", "issubclass"}


def uses_of_kinds(tree, module):
    """Line and text of each place that knows a kind of another module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                if node.module != module and (node.module in MODULES or full in MODULES):
                    yield node.lineno, full
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name in MODULES)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in TESTS:
            named = {n.attr if isinstance(n, ast.Attribute) else n.id for n in _classes(node.args[1])}
            if any(name in KINDS and KINDS[name].__module__ != module for name in named):
                yield node.lineno, ast.unparse(node)
            if any(isinstance(n, ast.Call) for n in ast.walk(node.args[1])):
                yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Compare) and _is_kind(node.left):
            words = {
                n.value for side in node.comparators for n in ast.walk(side) if isinstance(n, ast.Constant)
            }
            if words & NAMES:
                yield node.lineno, ast.unparse(node)


def _classes(node):
    return (n for n in ast.walk(node) if isinstance(n, ast.Name | ast.Attribute))


def _is_kind(node):
    """Whether an expression is ``x.kind`` or ``x["kind"]`` of an element, not of a URDF's geometry."""
    if isinstance(node, ast.Subscript):
        return isinstance(node.slice, ast.Constant) and node.slice.value == "kind"
    if not isinstance(node, ast.Attribute) or node.attr != "kind":
        return False
    return not ast.unparse(node.value).endswith("geometry")


@pytest.mark.parametrize("package", ["spacerobot", "optim", "viz"])
def test_no_module_knows_a_kind_of_element_but_its_own(package):
    found = []
    for place, tree in parsed_modules(package):
        module = place.removesuffix(".py").replace("/", ".")
        found += [f"{place}:{line}: {text}" for line, text in uses_of_kinds(tree, module)]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "from spacerobot.elements.grasps.compliant import Compliant",
        "from spacerobot.elements.grasps import compliant",
        "import spacerobot.elements.grasps.compliant",
        "isinstance(grasp, Compliant)",
        "isinstance(grasp, (str, compliant.Compliant))",
        "isinstance(grasp, kinds('grasp')['compliant'])",
        "controller.kind == 'mpc'",
        "section['kind'] in ('mpc', 'pid')",
    ],
)
def test_what_knows_a_kind_is_found(text):
    assert list(uses_of_kinds(ast.parse(text), "somewhere"))
