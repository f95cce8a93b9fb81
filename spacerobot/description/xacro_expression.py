"""Restricted evaluator of expressions in xacro files: arithmetic, containers and listed functions.

The xacro package evaluates ``${...}`` by Python's ``eval``, from which attributes of any object lead to the
interpreter (``().__class__.__base__.__subclasses__()``). This module evaluates the syntax tree and accepts
only the node types below. Attributes are entries of namespaces and YAML mappings, or listed methods of plain
values.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

MAX_BITS = 100_000
"""Maximum bits of an integer, or items of a repeated sequence, that an operator may return."""
WITHHELD = ("type", "vars", "repr", "hash")
"""Removed functions of xacro's namespace ``python``, which read arbitrary objects."""

_METHODS: dict[type, tuple[str, ...]] = {
    str: (
        *(
            "capitalize",
            "count",
            "endswith",
            "find",
            "index",
            "isdigit",
            "join",
            "lower",
            "lstrip",
            "replace",
        ),
        *("rstrip", "split", "startswith", "strip", "title", "upper"),
    ),
    list: ("count", "index"),
    tuple: ("count", "index"),
    dict: ("get", "items", "keys", "values"),
}
"""Allowed methods by type; none formats text or modifies a value."""
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Invert: operator.invert,
}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda item, container: item in container,
    ast.NotIn: lambda item, container: item not in container,
}


class ExpressionError(Exception):
    """Expression with a part of Python that is not allowed in xacro files."""


def evaluate(expression: str, symbols: Mapping[str, Any], _: Any = None) -> Any:
    """Evaluate a xacro expression in a safe subset of Python.

    Args:
        expression: Text between ``${`` and ``}``.
        symbols: Values, functions and namespaces by name. Functions are called without restrictions and must
            therefore be safe.

    Raises:
        ExpressionError: If the expression has a part of the language, an attribute or a size that is not
            allowed.
        NameError: If it has an unknown name.
    """
    return _Evaluator(symbols).value(ast.parse(expression.strip(), "<expression>", "eval").body)


class _Evaluator:
    """Evaluator of a syntax tree with symbols and the variables of comprehensions."""

    def __init__(self, symbols: Mapping[str, Any]) -> None:
        self._symbols = symbols
        self._variables: dict[str, Any] = {}

    def value(self, node: ast.AST) -> Any:
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ExpressionError(f"found {type(node).__name__}, which an expression may not use")
        return method(node)

    def _constant(self, node: ast.Constant) -> Any:
        return node.value

    def _name(self, node: ast.Name) -> Any:
        if node.id in self._variables:
            return self._variables[node.id]
        if node.id.startswith("__") or node.id not in self._symbols:
            raise NameError(f"name {node.id!r} is not defined")
        return self._symbols[node.id]

    def _attribute(self, node: ast.Attribute) -> Any:
        holder, name = self.value(node.value), node.attr
        if not name.startswith("_"):
            if isinstance(holder, dict) and name in holder:
                return holder[name]
            for kind, methods in _METHODS.items():
                if isinstance(holder, kind) and name in methods:
                    return getattr(kind, name).__get__(holder)
        raise ExpressionError(
            f"found the attribute {name!r} of a {type(holder).__name__}, which is not allowed"
        )

    def _subscript(self, node: ast.Subscript) -> Any:
        return self.value(node.value)[self.value(node.slice)]

    def _slice(self, node: ast.Slice) -> slice:
        return slice(*(part and self.value(part) for part in (node.lower, node.upper, node.step)))

    def _call(self, node: ast.Call) -> Any:
        function = self.value(node.func)
        if any(keyword.arg is None for keyword in node.keywords):
            raise ExpressionError("found **, which an expression may not use")
        named = {str(keyword.arg): self.value(keyword.value) for keyword in node.keywords}
        return function(*self._items(node.args), **named)

    def _items(self, nodes: list[ast.expr]) -> Iterator[Any]:
        for node in nodes:
            if isinstance(node, ast.Starred):
                yield from self.value(node.value)
            else:
                yield self.value(node)

    def _tuple(self, node: ast.Tuple) -> tuple[Any, ...]:
        return tuple(self._items(node.elts))

    def _list(self, node: ast.List) -> list[Any]:
        return list(self._items(node.elts))

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _boolop(self, node: ast.BoolOp) -> Any:
        stops = isinstance(node.op, ast.Or)
        for operand in node.values:
            value = self.value(operand)
            if bool(value) == stops:
                break
        return value

    def _compare(self, node: ast.Compare) -> bool:
        left = self.value(node.left)
        for comparison, operand in zip(node.ops, node.comparators, strict=True):
            right = self.value(operand)
            if not _COMPARISONS[type(comparison)](left, right):
                return False
            left = right
        return True

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        return _UNARY[type(node.op)](self.value(node.operand))

    def _binop(self, node: ast.BinOp) -> Any:
        left, right = self.value(node.left), self.value(node.right)
        operation = _BINARY.get(type(node.op))
        if operation is None:
            raise ExpressionError(f"found {type(node.op).__name__}, which an expression may not use")
        if _result_bits(node.op, left, right) > MAX_BITS:
            raise ExpressionError(f"gives a value of more than {MAX_BITS} bits or items")
        return operation(left, right)

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        return [self.value(node.elt) for _ in self._rounds(node.generators)]

    _generatorexp = _listcomp

    def _rounds(self, generators: list[ast.comprehension]) -> Iterator[None]:
        """Iterate over the elements of a comprehension, with its variables bound."""
        if not generators:
            yield
            return
        first, *others = generators
        outer = self._variables
        for item in self.value(first.iter):
            self._variables = {**outer, **_bound(first.target, item)}
            if all(self.value(condition) for condition in first.ifs):
                yield from self._rounds(others)
        self._variables = outer


def _bound(target: ast.expr, item: Any) -> dict[str, Any]:
    """Values of the variables in a comprehension's target."""
    if isinstance(target, ast.Name):
        return {target.id: item}
    if isinstance(target, ast.Tuple):
        parts = [_bound(each, value) for each, value in zip(target.elts, item, strict=True)]
        return {name: value for part in parts for name, value in part.items()}
    raise ExpressionError(f"found {type(target).__name__}, which a comprehension may not assign to")


def _result_bits(operation: ast.operator, left: Any, right: Any) -> int:
    """Upper bound of the bits of an integer, or the items of a sequence, that an operator returns."""
    if isinstance(operation, ast.Mult):
        for sequence, count in ((left, right), (right, left)):
            if isinstance(sequence, str | list | tuple) and isinstance(count, int):
                return len(sequence) * max(count, 0)
    if isinstance(operation, ast.Mod) and isinstance(left, str):
        # "%9999999d" % 1 has as many characters as its width
        return MAX_BITS + 1 if re.search(r"[0-9]{4}|\*", left) else 0
    if not (isinstance(left, int) and isinstance(right, int)):
        return 0
    if isinstance(operation, ast.Pow):
        return left.bit_length() * max(right, 0)
    if isinstance(operation, ast.LShift):
        return left.bit_length() + max(right, 0)
    return left.bit_length() + right.bit_length()
